"""What a function on secrets is called with: secrets, public arrays, and what is static."""

import inspect
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import jax

from ciphernav_jax.ring.fixed_point import no_gradient
from ciphernav_jax.secret.array import is_secret


@jax.tree_util.register_static
@dataclass(frozen=True)
class Static:
    """A value that decides what is traced; a pytree without leaves."""

    value: Any


class Arguments(NamedTuple):
    """Positional and keyword arguments, those that are static wrapped (`Static`)."""

    args: tuple[Any, ...]
    kwargs: dict[str, Any]

    @property
    def plain(self) -> "Arguments":
        """The same with static values as they are."""
        return jax.tree.map(_plain, self, is_leaf=_is_static)

    @property
    def static(self) -> tuple[Any, ...]:
        """The values that are static."""
        return tuple(x.value for x in jax.tree.leaves(self, is_leaf=_is_static) if isinstance(x, Static))


def _is_static(x: Any) -> bool:
    return isinstance(x, Static)


def given(
    function: Callable[..., Any], static: Sequence[str], args: tuple[Any, ...], kwargs: dict[str, Any]
) -> Arguments:
    """The arguments of a call, ready to be traced.

    Args:
        function: the one that is called.
        static: names of its parameters.

    Raises:
        ValueError: the function has no parameter of a name in `static`.
        TypeError: something else than an array, a number or a `Secret` is not static; what is cannot be
            hashed, or holds a secret; or an argument is being differentiated.
    """
    parameters = inspect.signature(function).parameters if static else {}
    names = list(parameters)
    strays = [name for name in static if name not in names]
    if strays and all(x.kind is not x.VAR_KEYWORD for x in parameters.values()):
        raise ValueError(f"static_argnames has {strays[0]!r}; the parameters are {', '.join(names)}")

    def prepared(name: str, x: Any) -> Any:
        if name in static:
            return _static(name, x)
        return jax.tree.map(lambda leaf: _leaf(name, leaf), x, is_leaf=is_secret)

    # More than there are parameters are those of a *args.
    named = [*names, *(f"number {i}" for i in range(len(names), len(args)))]
    return Arguments(
        tuple(prepared(name, x) for name, x in zip(named, args, strict=False)),
        {name: prepared(name, x) for name, x in kwargs.items()},
    )


def _plain(x: Any) -> Any:
    return x.value if isinstance(x, Static) else x


def _static(name: str, x: Any) -> Static:
    if any(map(is_secret, jax.tree.leaves(x, is_leaf=is_secret))):
        raise TypeError(f"the argument {name} holds a secret, and cannot be static")
    try:
        hash(x)
    except TypeError:
        raise TypeError(
            f"the static argument {name} is a {type(x).__name__}, which cannot be hashed: a static argument "
            "is part of the compiled program. Give a tuple, a frozen dataclass, a number or a string."
        ) from None
    return Static(x)


def _leaf(name: str, x: Any) -> Any:
    if is_secret(x) or isinstance(x, jax.ShapeDtypeStruct):
        return x
    if not hasattr(x, "dtype") and not isinstance(x, complex | float | int):
        raise TypeError(
            f"the argument {name} of a function on secrets has a {type(x).__name__}, which is no array. "
            "Name it in secure(f, static_argnames=...), or have the function close over it."
        )
    return no_gradient(x)
