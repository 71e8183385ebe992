"""Secret-shared machine learning, simulated in JAX.

The packages in import order; each imports only from those above it.

- `files`: files that are whole or absent, and are what was written.
- `lifeline`: child processes that end with their parent.
- `command_line`: ranges of options, and how a command ends.
- `ring`: arithmetic of the integers modulo 2^64: fixed point, products, bits, randomness.
- `protocols`: what parties do with shares: open, multiply, truncate, compare; the dealer.
- `secret`: from functions on floats to functions on secrets.
- `world`: Obstacle World, its environment, renderer and data set; no secrets here.
- `models`: the paper's encoders and action classifier.
- `navigation`: training, plain and secret, and closed-loop evaluation.
- `experiments`: measurements: speed, beside what the machine can do and beside other frameworks.
- `cli`: the command line `ciphernav`.

Importing the package registers the gymnasium environment, switches JAX's 64-bit types on, gives JAX a
folder for its compilation cache (`compilation_cache`) and has it use wide vectors (`vectors`). The names of
the public face are imported on first use, so that the processes that render Obstacle World never load JAX.
"""

import importlib
import os
import sys

from ciphernav_jax import allocator, compilation_cache, vectors, world  # noqa: F401  (world registers the gymnasium environment)

__version__ = "0.1.0"

# Ring elements are uint64, so 64-bit types are switched on, without importing JAX to do it.
if "jax" in sys.modules:
    sys.modules["jax"].config.update("jax_enable_x64", True)
else:
    os.environ["JAX_ENABLE_X64"] = "1"

allocator.keep_large_buffers()
compilation_cache.switch_on()
vectors.prefer_widest()

_HOME = {
    "KeyReuseWarning": "secret",
    "LAN": "secret",
    "Network": "secret",
    "Protocol": "protocols",
    "Secret": "secret",
    "ValidationError": "secret",
    "WAN": "secret",
    "audit": "secret",
    "cost": "secret",
    "deploy": "secret",
    "reveal": "secret",
    "secure": "secret",
    "share": "secret",
    "simulate": "secret",
    "transcript": "secret",
    "validate": "secret",
}
_PACKAGES = ("ring", "protocols", "secret", "models", "navigation", "experiments")

__all__ = sorted([*_HOME, *_PACKAGES, "world"])  # pyright: ignore[reportUnsupportedDunderAll]


def __getattr__(name: str):
    if name in _PACKAGES:
        return importlib.import_module(f"{__name__}.{name}")
    if name in _HOME:
        return getattr(importlib.import_module(f"{__name__}.{_HOME[name]}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return [*globals(), *__all__]
