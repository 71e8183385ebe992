"""Secret-shared machine learning, simulated in JAX.

In import order; each imports only from those above it.

- `startup`: what importing the package sets: 64 bits, allocator, compilation cache, vectors.
- `extras`: what some parts need and functions on secrets do without.
- `files`: files that are whole or absent, and are what was written.
- `jax_private`: what JAX does not promise to keep; nowhere else is it touched.
- `lifeline`: child processes that end with their parent.
- `command_line`: ranges of options, and how a command ends.
- `provenance`: on what and when a result was made.
- `tables`: tables for a terminal and in Markdown, and a bar.
- `ring`: arithmetic of the integers modulo 2^64: fixed point, products, bits, randomness.
- `parties`: how one party's program is run and watched; the dealer.
- `protocols`: what parties compute on shares: products, truncation, comparison.
- `secret`: from functions on floats to functions on secrets.
- `comparison`: one's own function over protocol variants and numbers of parties.
- `learning`: training in secret on columns that owners hold, whatever the data set.
- `world`: Obstacle World, its environment, renderer and data set; no secrets here.
- `models`: the paper's encoders and action classifier.
- `navigation`: training, plain and secret, and closed-loop evaluation.
- `cli`: the command line `ciphernav`.

Importing the package switches JAX's 64-bit types on, gives JAX a folder for its compilation cache, has it
use wide vectors (`startup`), and registers the gymnasium environment where the extra `navigation` is
installed. The names of the public face are imported on first use, so that the processes that render Obstacle
World never load JAX.
"""

import importlib
from typing import TYPE_CHECKING

from ciphernav_jax import extras, startup

__version__ = "0.1.0"

startup.prepare()
if not extras.missing("navigation"):
    from ciphernav_jax import world

_HOME = {
    "KeyReuseWarning": "secret",
    "LAN": "secret",
    "Network": "secret",
    "Protocol": "protocols",
    "Secret": "secret",
    "ValidationError": "secret",
    "WAN": "secret",
    "audit": "secret",
    "compare": "comparison",
    "cost": "secret",
    "deploy": "secret",
    "reshare": "secret",
    "reveal": "secret",
    "secure": "secret",
    "share": "secret",
    "simulate": "secret",
    "transcript": "secret",
    "validate": "secret",
}
_PACKAGES = (
    "ring",
    "parties",
    "protocols",
    "secret",
    "comparison",
    "learning",
    "models",
    "navigation",
    "world",
)

if TYPE_CHECKING:  # for editors, which do not look into __getattr__
    from ciphernav_jax import (
        comparison,
        learning,
        models,
        navigation,
        parties,
        protocols,
        ring,
        secret,
        world,
    )
    from ciphernav_jax.comparison import compare
    from ciphernav_jax.protocols import Protocol
    from ciphernav_jax.secret import (
        LAN,
        WAN,
        KeyReuseWarning,
        Network,
        Secret,
        ValidationError,
        audit,
        cost,
        deploy,
        reshare,
        reveal,
        secure,
        share,
        simulate,
        transcript,
        validate,
    )

__all__ = [
    "LAN",
    "WAN",
    "KeyReuseWarning",
    "Network",
    "Protocol",
    "Secret",
    "ValidationError",
    "audit",
    "compare",
    "comparison",
    "cost",
    "deploy",
    "learning",
    "models",
    "navigation",
    "parties",
    "protocols",
    "reshare",
    "reveal",
    "ring",
    "secret",
    "secure",
    "share",
    "simulate",
    "transcript",
    "validate",
    "world",
]


def __getattr__(name: str):
    if name in _PACKAGES:
        return importlib.import_module(f"{__name__}.{name}")
    if name in _HOME:
        return getattr(importlib.import_module(f"{__name__}.{_HOME[name]}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return [*globals(), *__all__]
