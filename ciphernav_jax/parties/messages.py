"""What passes between the parties, read from the jaxpr of one party's program: every opening, its size, and
its round. Nothing is run.

A program whose jaxpr reaches other parties by any other way than the collectives of `party` is refused
(`locality`).
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ciphernav_jax.jax_private import ClosedJaxpr, Jaxpr, JaxprEqn, Literal, place
from ciphernav_jax.parties import party
from ciphernav_jax.parties.jaxprs import labels, names, opened_up, wrapped
from ciphernav_jax.parties.locality import collective, inner_jaxprs


@dataclass(frozen=True)
class Opening:
    """One opening in a party's program: what each party sends of one array.

    Attributes:
        collective: "open_sum", "open_xor" or "open_shares"; or "ideal_sum", which is no message.
        protocol: the outermost protocol that opens it; "" outside of any.
        primitive: the innermost primitive of the user's function that it serves; "" outside of any.
        shape, dtype: of what one party sends.
        rounds: the rounds in which it is sent, counted from 1: one for each time. An array is sent in the
            round after the last of those whose openings it depends on, so independent ones share a round. A
            loop is one step here: it starts when all it reads is there, and goes iteration by iteration.
        per_iteration: it stands in a `while`, whose iterations nobody knows; it is counted for one.
    """

    collective: str
    protocol: str
    primitive: str
    shape: tuple[int, ...]
    dtype: np.dtype
    rounds: tuple[int, ...]
    per_iteration: bool = False

    @property
    def ideal(self) -> bool:
        """Whether a trusted third party takes the place of a protocol here: nothing is sent."""
        return self.collective == party.ideal_sum.__name__

    @property
    def words(self) -> int:
        """Entries that each party sends, over all times; none where it is ideal."""
        return 0 if self.ideal else math.prod(self.shape) * len(self.rounds)

    @property
    def size(self) -> int:
        """Bytes that each party sends to each other party, over all times."""
        return self.words * self.dtype.itemsize

    def later(self, rounds: int) -> "Opening":
        return replace(self, rounds=tuple(r + rounds for r in self.rounds))


def openings(jaxpr: ClosedJaxpr) -> tuple[Opening, ...]:
    """All openings of one party's program, in the order of its jaxpr.

    A `scan` is multiplied out. Of a `cond` (its predicate is public) the costliest branch is counted: most
    rounds, then most bytes. A `while` is counted for one iteration, and its openings say so.

    Args:
        jaxpr: of one party's program, traced with the parties' axis in scope (`run.one_partys_jaxpr`).

    Raises:
        ValueError: the program reaches other parties otherwise than by an opening, or opens in the body of
            an operation whose rounds cannot be known.
    """
    return tuple(_walk(jaxpr.jaxpr, [0] * len(jaxpr.jaxpr.invars), "")[1])


def depth(found: Iterable[Opening]) -> int:
    """The number of rounds that openings take."""
    return max((r for opening in found if not opening.ideal for r in opening.rounds), default=0)


def _walk(jaxpr: Jaxpr, arrivals: Sequence[int], stack: str) -> tuple[list[int], list[Opening]]:
    """The rounds after which the outputs are there, given those of the inputs; and the openings."""
    there: dict[Any, int] = dict(zip(jaxpr.invars, arrivals, strict=True))

    def after(atom) -> int:
        return 0 if isinstance(atom, Literal) else there.get(atom, 0)  # constants are there from the start

    found: list[Opening] = []
    for eqn in jaxpr.eqns:
        inside = names(eqn, stack)
        inner = wrapped(eqn)
        name = collective(eqn, inside)
        if inner is not None:
            done, new = _walk(inner[0], [after(atom) for atom in eqn.invars], inside)
        elif name is not None:
            new = [_opening(name, inside, atom, after(atom)) for atom in eqn.invars]
            done = [max(after(atom), depth([opening])) for atom, opening in zip(eqn.invars, new, strict=True)]
        else:
            start = max(map(after, eqn.invars), default=0)
            new = [opening.later(start) for opening in openings_within(eqn, inside)]
            done = [max(start, depth(new))] * len(eqn.outvars)
        found += new
        there.update(zip(eqn.outvars, done, strict=True))
    return [after(atom) for atom in jaxpr.outvars], found


def _opening(name: str, stack: str, atom: Any, arrival: int) -> Opening:
    protocols, primitives = labels(stack, "protocol"), labels(stack, "primitive")
    return Opening(
        collective=name,
        protocol=protocols[0] if protocols else "",
        primitive=primitives[-1] if primitives else "",
        shape=atom.aval.shape,
        dtype=np.dtype(atom.aval.dtype),
        rounds=(arrival + 1,),
    )


def openings_within(eqn: JaxprEqn, stack: str) -> list[Opening]:
    """The openings inside one equation that is not `wrapped`, their rounds counted from its start."""

    def of(jaxpr):
        jaxpr = opened_up(jaxpr)[0]
        return _walk(jaxpr, [0] * len(jaxpr.invars), stack)[1]

    match eqn.primitive.name:
        case "scan":
            body = of(eqn.params["jaxpr"])
            step = depth(body)
            return [
                replace(
                    opening,
                    rounds=tuple(i * step + r for i in range(eqn.params["length"]) for r in opening.rounds),
                )
                for opening in body
            ]
        case "cond":
            branches = [of(branch) for branch in eqn.params["branches"]]
            return max(branches, key=lambda found: (depth(found), sum(o.size for o in found), len(found)))
        case "while":
            condition, body = of(eqn.params["cond_jaxpr"]), of(eqn.params["body_jaxpr"])
            body = [opening.later(depth(condition)) for opening in body]
            return [replace(opening, per_iteration=True) for opening in condition + body]
    if any(of(inner) for inner in inner_jaxprs(eqn)):
        raise ValueError(
            f"a party's program opens something inside `{eqn.primitive.name}`, at "
            f"{place(eqn)}, where rounds cannot be counted. "
            "Open it outside, or in lax.scan, lax.cond or lax.while_loop."
        )
    return []


def first_uses(jaxpr: Jaxpr, stack: str = "") -> dict[int, str]:
    """For each input of a jaxpr that is used, by its number, the names under which it first is: in the order
    of these first uses.
    """
    used: dict[Any, str] = {}
    for eqn in jaxpr.eqns:
        inside = names(eqn, stack)
        inner = wrapped(eqn)
        if inner is None and eqn.primitive.name == "scan":
            inner = opened_up(eqn.params["jaxpr"])
        uses = (
            dict.fromkeys(range(len(eqn.invars)), inside) if inner is None else first_uses(inner[0], inside)
        )
        for i, use in uses.items():
            if not isinstance(eqn.invars[i], Literal):
                used.setdefault(eqn.invars[i], use)
    numbers = {variable: i for i, variable in enumerate(jaxpr.invars)}
    return {numbers[variable]: use for variable, use in used.items() if variable in numbers}
