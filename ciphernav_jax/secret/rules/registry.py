"""Which rule a primitive has.

A rule is called as `rule(context, *operands, **params)` with the primitive's own parameters. Operands are
`Value` (secret) or arrays (public; a numpy array where the value is known while tracing), and at least one is
secret. It returns the result, or a list of them where the primitive has several. `context` has what else it
may need: the equation with the shapes and types of operands and results, and the evaluator, for a primitive
that holds jaxprs.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import jax

from ciphernav_jax.secret.value import Context

Rule = Callable[..., Any]
RULES: dict[str, Rule] = {}

MOVES: set[str] = set()
"""Primitives that compute nothing: an entry that stands for no number stays recognisable as such."""

CONTROL_FLOW: set[str] = set()
"""Primitives that hold jaxprs, whose own equations have what is said of a rule: types, names, notes."""


class Unsupported(Exception):
    """A rule cannot take these operands; the message says why, and the way out."""


def rule(*names: str, moves: bool = False, control_flow: bool = False) -> Callable[[Rule], Rule]:
    """Registers a rule under the names of primitives; see `MOVES` and `CONTROL_FLOW`."""

    def register(function: Rule) -> Rule:
        RULES.update(dict.fromkeys(names, function))
        for kind, said in ((MOVES, moves), (CONTROL_FLOW, control_flow)):
            if said:
                kind.update(names)
        return function

    return register


def composed(*names: str) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Registers a rule that is written as a JAX function of simpler primitives, and gets the primitive's
    parameters as keywords. What they cost and how far they err is the composed one's.
    """

    def register(function: Callable[..., Any]) -> Callable[..., Any]:
        @rule(*names)
        def evaluated(context: Context, *operands: Any, **params: Any) -> Any:
            assert context.eqn is not None
            avals: list[Any] = [x.aval for x in context.eqn.invars]
            shapes = [jax.ShapeDtypeStruct(x.shape, x.dtype) for x in avals]
            jaxpr = jax.make_jaxpr(lambda *xs: function(*xs, **params))(*shapes)
            results = replace(context, composed=True).evaluate(jaxpr, list(operands))
            return results if context.eqn.primitive.multiple_results else results[0]

        return function

    return register
