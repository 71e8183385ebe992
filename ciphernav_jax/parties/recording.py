"""A program run with all its messages kept: the same jaxpr, evaluated with every opening as an output."""

from dataclasses import dataclass, field
from typing import Any

import jax
from jax import Array, lax
from jax import numpy as jnp
from jaxtyping import UInt64

from ciphernav_jax.jax_private import Jaxpr, JaxprEqn, Literal, bind, place, scan_parts
from ciphernav_jax.parties import party
from ciphernav_jax.parties.dealer import deal
from ciphernav_jax.parties.jaxprs import labels, names, opened_up, wrapped
from ciphernav_jax.parties.locality import collective
from ciphernav_jax.parties.messages import Opening, openings, openings_within
from ciphernav_jax.parties.run import DealtProgram, one_partys_jaxpr, online, plan
from ciphernav_jax.ring.random import Generator

Recorded = tuple[list[Any], list[Array], list[Array]]  # results, sent, opened


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Message:
    """One opening of a run; a pytree with the leaves `sent` and `opened`.

    Attributes:
        sent: uint64[P, ...], what each party sends to all others.
        opened: uint64[...], what all parties then know of it: the sum or the exclusive or of the rows, or the
            P rows themselves. In a `lax.scan` the iterations are the leading axis of it, and follow the
            party axis of `sent`.
        opening: its collective, protocol, primitive and rounds.
    """

    sent: UInt64[Array, "p ..."]
    opened: UInt64[Array, "..."]
    opening: Opening = field(metadata={"static": True})

    @property
    def name(self) -> str:
        """Which primitive, in which protocol, by which collective."""
        parts = (self.opening.primitive, self.opening.protocol, self.opening.collective)
        return "/".join(part for part in parts if part)


def run_recorded(
    program: DealtProgram,
    key: Array,
    parties: int,
    private: Any,
    public: Any,
    generator: Generator = "threefry",
) -> tuple[tuple[Any, Any], tuple[Message, ...]]:
    """As `run.run`, simulated: what that returns, bit for bit, and all messages in the program's order.

    Ideal sums are no messages, and left out.

    Raises:
        NotImplementedError: something is opened in a `cond` or a `while`.
    """
    needed = plan(program, parties, private, public)
    private = deal(key, needed, parties, generator), private
    jaxpr, shapes = one_partys_jaxpr(online(program, needed), parties, private, public)

    def recorded(private, public):
        inputs = jax.tree.leaves((private, public))
        results, sent, opened = _evaluate(jaxpr.jaxpr, jaxpr.consts, inputs, "")
        mine, known = jax.tree.unflatten(jax.tree.structure(shapes), results)
        return (mine, sent), (known, opened)

    (mine, sent), (known, opened) = party.simulate(recorded, parties)(private, public)
    kinds = [opening for opening in openings(jaxpr) if not opening.ideal]
    return (mine, known), tuple(Message(*parts) for parts in zip(sent, opened, kinds, strict=True))


def _evaluate(jaxpr: Jaxpr, consts: list[Any], args: list[Any], stack: str) -> Recorded:
    env: dict[Any, Any] = dict(zip([*jaxpr.constvars, *jaxpr.invars], [*consts, *args], strict=True))

    def read(atom):
        return atom.val if isinstance(atom, Literal) else env[atom]

    sent: list[Array] = []
    opened: list[Array] = []
    for eqn in jaxpr.eqns:
        operands = [read(atom) for atom in eqn.invars]
        inside = names(eqn, stack)
        inner = wrapped(eqn)
        if inner is not None:
            results, more_sent, more_opened = _evaluate(*inner, operands, inside)
        elif any(not opening.ideal for opening in openings_within(eqn, inside)):
            results, more_sent, more_opened = _scan(eqn, operands, inside)
        else:
            results = bind(eqn, operands)
            more_sent, more_opened = _message(collective(eqn, inside), operands, results)
        sent += more_sent
        opened += more_opened
        env.update(zip(eqn.outvars, results, strict=True))
    return [read(atom) for atom in jaxpr.outvars], sent, opened


def _message(name: str | None, operands: list[Any], results: list[Any]) -> tuple[list[Array], list[Array]]:
    """What an equation sends and opens: nothing, unless it is a collective that sends."""
    if name is None or name == party.ideal_sum.__name__:
        return [], []
    if name == party.open_xor.__name__:
        results = [lax.reduce_xor(rows, axes=(0,)) for rows in results]
    return operands, results


def _scan(eqn: JaxprEqn, operands: list[Any], stack: str) -> Recorded:
    if eqn.primitive.name != "scan":
        line = next(reversed(labels(stack, "at")), place(eqn))
        raise NotImplementedError(
            f"cannot record what is opened inside `{eqn.primitive.name}`, at {line}: how much is sent "
            "depends on public values that are known only when it runs. Use lax.scan, or record the branch "
            "or the body by itself."
        )
    params = eqn.params
    jaxpr, consts = opened_up(params["jaxpr"])
    fixed, start, xs = scan_parts(params, operands)

    def step(carry, x):
        results, sent, opened = _evaluate(jaxpr, consts, [*fixed, *carry, *x], stack)
        return results[: len(start)], (results[len(start) :], sent, opened)

    carry, (ys, sent, opened) = lax.scan(
        step,
        start,
        xs,
        length=params["length"],
        reverse=params["reverse"],
        unroll=params["unroll"],
    )
    if params["reverse"]:  # in the order in which they were sent
        sent, opened = ([jnp.flip(x, axis=0) for x in arrays] for arrays in (sent, opened))
    return [*carry, *ys], sent, opened
