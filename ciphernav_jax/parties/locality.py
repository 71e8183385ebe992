"""What a party's program may do: what is local, and the collectives of `party`, at the same points of the
program for all parties. All of it is read from the program's jaxpr; nothing is run.
"""

from collections.abc import Iterator, Sequence
from typing import Any

import jax

from ciphernav_jax.jax_private import (
    GATHER,
    SUM,
    ClosedJaxpr,
    Jaxpr,
    JaxprEqn,
    Literal,
    place,
    scan_parts,
    side_effects,
)
from ciphernav_jax.parties import party
from ciphernav_jax.parties.jaxprs import innermost, jaxprs_in, opened_up, wrapped

# Each collective of `party`, named by its scope, and the primitives that may carry it.
COLLECTIVES = {
    party.open_sum.__name__: SUM,
    party.open_xor.__name__: GATHER,
    party.open_shares.__name__: GATHER,
    party.ideal_sum.__name__: SUM,
}
# Knows the parties' axis, and says which party this is: local.
WHICH_PARTY = "axis_index"


def leaves(eqn: JaxprEqn) -> bool:
    """Whether an equation, itself, does anything beyond local arithmetic: it knows of the other parties, or
    calls, prints, or does whatever else its jaxpr does not say.
    """
    return _acts_outside(eqn) or _mentions_the_axis(eqn)


def collective(eqn: JaxprEqn, stack: str) -> str | None:
    """The name of the collective that an equation is, or None where it is local.

    Raises:
        ValueError: it is neither.
    """
    name = eqn.primitive.name
    if not leaves(eqn) or name == WHICH_PARTY:
        return None
    scope = innermost(stack)
    if name in COLLECTIVES.get(scope, ()) and eqn.params.get("axis_index_groups") is None:
        return scope
    raise ValueError(
        f"a party's program leaves the party by `{name}`, at {place(eqn)}. "
        f"Parties reach each other by {', '.join(COLLECTIVES)} of ciphernav_jax.parties.party alone."
    )


def require_in_step(jaxpr: ClosedJaxpr, own: int) -> None:
    """Whether a party opens something is decided by what all parties know.

    Otherwise one would wait for others that do not answer; and that it waits, and for what, would tell them
    something. A condition is known to all if it follows from public inputs, constants and what was opened.

    Args:
        jaxpr: of one party's program.
        own: how many of its first inputs are a party's own: shares and all else that others may not have.

    Raises:
        ValueError: something is opened in a branch or a loop whose condition may differ between parties.
    """
    program = opened_up(jaxpr)[0]
    _differing(program, [i < own for i in range(len(program.invars))])


def inner_jaxprs(eqn: JaxprEqn) -> Iterator[Jaxpr]:
    """All jaxprs among an equation's parameters, without their constants."""
    return (opened_up(inner)[0] for inner in jaxprs_in(eqn))


def equations(jaxpr: Jaxpr) -> Iterator[JaxprEqn]:
    """All equations of a jaxpr, and before each those within it."""
    for eqn in jaxpr.eqns:
        for inner in inner_jaxprs(eqn):
            yield from equations(inner)
        yield eqn


def _acts_outside(eqn: JaxprEqn) -> bool:
    name = eqn.primitive.name
    within = {effect for inner in inner_jaxprs(eqn) for effect in side_effects(inner)}
    # A pure callback claims to have no effect.
    return "callback" in name or name == "ffi_call" or bool(side_effects(eqn) - within)


def _mentions_the_axis(eqn: JaxprEqn) -> bool:
    named = [value for key, value in eqn.params.items() if key != "name"]
    return any(
        leaf == party.AXIS if isinstance(leaf, str) else isinstance(leaf, frozenset) and party.AXIS in leaf
        for leaf in jax.tree.leaves(named)
    )


def _opens(jaxpr: Any) -> bool:
    within = equations(opened_up(jaxpr)[0])
    return any(_mentions_the_axis(eqn) and eqn.primitive.name != WHICH_PARTY for eqn in within)


def _differing(jaxpr: Any, inputs: Sequence[bool]) -> list[bool]:
    """Which outputs may differ between parties, given which inputs do."""
    jaxpr = opened_up(jaxpr)[0]
    differs: dict[Any, bool] = dict(zip(jaxpr.invars, inputs, strict=True))

    def of(atom: Any) -> bool:
        return not isinstance(atom, Literal) and differs.get(atom, False)  # constants are the same for all

    for eqn in jaxpr.eqns:
        outputs = _outputs(eqn, [of(atom) for atom in eqn.invars])
        differs.update(zip(eqn.outvars, outputs, strict=True))
    return [of(atom) for atom in jaxpr.outvars]


def _outputs(eqn: JaxprEqn, inputs: list[bool]) -> list[bool]:
    if (inner := wrapped(eqn)) is not None:
        return _differing(inner[0], inputs)
    params = eqn.params
    match eqn.primitive.name:
        case "cond":
            index, *operands = inputs
            branches = params["branches"]
            _require_same(eqn, index, *branches)
            outputs = [_differing(branch, operands) for branch in branches]
            return [index or any(of_branch) for of_branch in zip(*outputs, strict=True)]
        case "while":
            first, second = params["cond_nconsts"], params["cond_nconsts"] + params["body_nconsts"]
            of_condition, of_body, start = inputs[:first], inputs[first:second], inputs[second:]
            carry = _settled(params["body_jaxpr"], of_body, start, [])[: len(start)]
            (going,) = _differing(params["cond_jaxpr"], [*of_condition, *carry])
            _require_same(eqn, going, params["cond_jaxpr"], params["body_jaxpr"])
            return [going or x for x in carry]
        case "scan":
            return _settled(params["jaxpr"], *scan_parts(params, inputs))
        case name if _mentions_the_axis(eqn):
            return [name == WHICH_PARTY] * len(eqn.outvars)
    asks_which = any(e.primitive.name == WHICH_PARTY for inner in inner_jaxprs(eqn) for e in equations(inner))
    return [asks_which or any(inputs)] * len(eqn.outvars)


def _settled(jaxpr: Any, consts: list[bool], carry: list[bool], xs: list[bool]) -> list[bool]:
    """The outputs of a loop's body after as many iterations as change anything."""
    while True:
        outputs = _differing(jaxpr, [*consts, *carry, *xs])
        after = [before or now for before, now in zip(carry, outputs[: len(carry)], strict=True)]
        if after == carry:
            return [*carry, *outputs[len(carry) :]]
        carry = after


def _require_same(eqn: JaxprEqn, condition_differs: bool, *parts: Any) -> None:
    if condition_differs and any(map(_opens, parts)):
        raise ValueError(
            f"a party's program opens something in a `{eqn.primitive.name}`, at {place(eqn)}, whose "
            "condition may differ between the parties. Whether something is opened must follow from what all "
            "of them know: public inputs, constants, and what was opened before."
        )
