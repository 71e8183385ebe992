"""What `pip install ciphernav_jax` leaves out: libraries that functions on secrets do without."""

from importlib.util import find_spec

NEEDED = {"navigation": ("flax", "optax", "gymnasium", "miniworld", "PIL", "tyro", "matplotlib")}
"""The modules of each extra."""


def missing(extra: str) -> list[str]:
    """The modules of an extra that are not installed."""
    return [name for name in NEEDED[extra] if find_spec(name) is None]


def require(extra: str, what: str, *modules: str) -> None:
    """Raises ModuleNotFoundError, which says what to install, where a module of the extra is missing: any, or
    one of those that are named.
    """
    if names := [name for name in missing(extra) if not modules or name in modules]:
        raise ModuleNotFoundError(
            f"{what} needs {', '.join(names)}: pip install 'ciphernav_jax[{extra}]'", name=names[0]
        )
