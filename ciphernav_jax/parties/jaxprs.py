"""Reading jaxprs: what an equation wraps, and under which names it was traced."""

import re
from collections.abc import Iterator
from typing import Any

import jax

from ciphernav_jax.jax_private import INLINED, ClosedJaxpr, Jaxpr, JaxprEqn, name_stack


def opened_up(x: Jaxpr | ClosedJaxpr) -> tuple[Jaxpr, list[Any]]:
    """A jaxpr and its constants."""
    return (x.jaxpr, x.consts) if isinstance(x, ClosedJaxpr) else (x, [])


def jaxprs_in(eqn: JaxprEqn) -> Iterator[Jaxpr | ClosedJaxpr]:
    """All jaxprs among an equation's parameters."""
    for value in jax.tree.leaves(list(eqn.params.values())):
        if isinstance(value, Jaxpr | ClosedJaxpr):
            yield value


def wrapped(eqn: JaxprEqn) -> tuple[Jaxpr, list[Any]] | None:
    """The jaxpr, with its constants, that the equation does nothing but call; None for any other equation."""
    parameter = INLINED.get(eqn.primitive.name)
    return None if parameter is None else opened_up(eqn.params[parameter])


def names(eqn: JaxprEqn, outside: str = "") -> str:
    """The `jax.named_scope`s of an equation, from the outermost in. A jaxpr that is a parameter of an
    equation begins its names anew; `outside` are those of that equation.
    """
    return f"{outside}/{name_stack(eqn)}"


def labels(stack: str, kind: str) -> list[str]:
    """The x of each "kind:x" among the names, from the outermost in."""
    return [name.removeprefix(f"{kind}:") for name in _split(stack) if name.startswith(f"{kind}:")]


def innermost(stack: str) -> str:
    """The last of the names; "" where there is none."""
    return next(reversed(_split(stack)), "")


def _split(stack: str) -> list[str]:
    # A transformation wraps the names: vmap(multiply)/open_sum.
    return [name for name in re.split(r"[/()]", stack) if name]
