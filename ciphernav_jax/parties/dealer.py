"""Correlated randomness from a trusted dealer: the plan of what a program asks for, and its generation.

A program asks for randomness through `Dealer.take(request)`, and gets its own shares of the dealer's values.
Tracing the program once with a `Planner` lists all requests without computing anything; `deal` then makes the
randomness of the whole program, from one large uniform draw for each party; a `Supply` hands it to the party.
So the dealer acts before the program starts (the offline phase), and the online phase holds no dealer at all:
in a deployment each party's part of the supply is its own input, which it draws from a seed that the dealer
sends it, but for the corrections.

The dealer is trusted, takes part in nothing else, and must not collude with a party.
"""

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, lax
from jaxtyping import UInt64

from ciphernav_jax import ring
from ciphernav_jax.jax_private import get_opaque_trace_state
from ciphernav_jax.parties import sharing
from ciphernav_jax.parties.requests import Ref, Request, Shape, Values
from ciphernav_jax.ring import keys
from ciphernav_jax.ring.random import Generator


class Dealt(dict[str, Array]):
    """What a party receives for one request: its shares by name, and the request's number."""

    def __init__(self, request: int, shares: Values):
        super().__init__(shares)
        self.request = request

    def ref(self, name: str) -> Ref:
        return Ref(self.request, name)


class Dealer(Protocol):
    """Where a party's program takes its correlated randomness from."""

    def take(self, request: Request) -> Dealt: ...


@dataclass(frozen=True)
class Plan:
    """All requests of a program in order, and the shapes of what a party has of the values of each."""

    requests: tuple[Request, ...]
    shapes: tuple[dict[str, Shape], ...]


@dataclass
class Planner:
    """A dealer that notes what a program asks for and hands out zeros. Use it under `jax.eval_shape`."""

    requests: list[Request] = field(default_factory=list)
    values: list[dict[str, jax.ShapeDtypeStruct]] = field(default_factory=list)
    shapes: list[dict[str, Shape]] = field(default_factory=list)

    def take(self, request: Request) -> Dealt:
        words = functools.partial(jax.ShapeDtypeStruct, dtype=jnp.uint64)
        drawn = {name: words(shape) for name, shape in request.uniform.items()}
        # Shapes do not depend on the number of parties.
        joined = {name: words((2, *x.shape)) if name in request.own else x for name, x in drawn.items()}
        dependent = jax.eval_shape(request.deal, joined, self.values)
        common = {name: words(shape) for name, shape in request.common.items()}
        self.requests.append(request)
        self.values.append(joined | dependent)
        self.shapes.append({name: x.shape for name, x in (drawn | dependent | common).items()})
        zeros = {name: jnp.zeros(shape, jnp.uint64) for name, shape in self.shapes[-1].items()}
        return Dealt(len(self.requests) - 1, zeros)

    def plan(self) -> Plan:
        return Plan(tuple(self.requests), tuple(self.shapes))


@dataclass
class Supply:
    """A dealer that hands out one party's part of randomness made beforehand, in the order of the plan.

    Make it where the program begins. What is taken in the body of a loop or a `vmap` of the program's own
    would be the same in every iteration, and a mask used twice shows the difference of what it hides;
    `take` refuses it.
    """

    plan: Plan
    shares: Sequence[Values]
    taken: int = 0
    beginning: Any = field(default_factory=get_opaque_trace_state, repr=False)

    def take(self, request: Request) -> Dealt:
        if get_opaque_trace_state() != self.beginning:
            raise RuntimeError(
                f"a program asked for {request} in the body of a loop, vmap or jit of its own, where every "
                "iteration would get the same randomness. Take it outside, with a row for each iteration, or "
                "loop around the whole program."
            )
        i = self.taken
        if i >= len(self.plan.requests) or request != self.plan.requests[i]:
            planned = self.plan.requests[i] if i < len(self.plan.requests) else "nothing more"
            raise RuntimeError(
                f"a program departed from its plan: it asked for {request}, planned was {planned}. "
                "What a program asks for must not depend on the values it is given."
            )
        self.taken += 1
        return Dealt(i, self.shares[i])


def corrected(plan: Plan, parties: int) -> list[dict[str, int]]:
    """For each request, the values that depend on others, and which party is sent its part of each: they take
    turns, whoever has been sent least so far.
    """
    sent = [0] * parties
    found: list[dict[str, int]] = []
    for request, shapes in zip(plan.requests, plan.shapes, strict=True):
        found.append({})
        for name, shape in shapes.items():
            if name not in request.uniform and name not in request.common:
                found[-1][name] = party = sent.index(min(sent))
                sent[party] += math.prod(shape)
    return found


def words_needed(plan: Plan, parties: int) -> list[int]:
    """How many uniform words each party draws: its shares of all that is uniform, and of all else but what it
    is sent.
    """
    needed = [0] * parties
    for request, shapes, sent in zip(plan.requests, plan.shapes, corrected(plan, parties), strict=True):
        for name in shapes.keys() - request.common.keys():
            for party in range(parties):
                needed[party] += math.prod(shapes[name]) * (sent.get(name) != party)
    return needed


def deal(
    key: Array, plan: Plan, parties: int, generator: Generator = "threefry"
) -> list[dict[str, UInt64[Array, "p ..."]]]:
    """The offline phase: all correlated randomness of a plan, as shares of `parties` parties.

    Each party has a stream of uniform words, from a key of its own. A uniform value is what the parties'
    words give together. Of any other value v one party, each in its turn, is sent v - sum(u_i), or the
    exclusive or, of the words u_i that the others draw.

    Returns:
        For each request a dict of uint64 arrays with the party as leading axis.
    """
    sharing.require_parties(parties)
    key = keys.derive(key, "dealer")
    streams = _Streams(keys.derive(key, "party", np.arange(parties)), plan, generator)
    told = [shape for request in plan.requests for shape in request.common.values()]
    common = iter(ring.draw(keys.derive(key, "all parties"), told, generator) if told else ())

    dealt: list[Values] = []
    supply: list[Values] = []
    for request, sent in zip(plan.requests, corrected(plan, parties), strict=True):
        shares = {name: streams.of_all(shape) for name, shape in request.uniform.items()}
        uniform = {name: request.join(name, rows) for name, rows in shares.items()}
        dependent = request.deal(uniform, dealt)
        for name, party in sent.items():
            split = sharing.split_xor if name in request.binary else sharing.split_sum
            value = dependent[name]
            others = [streams.of(i, value.shape) for i in range(parties) if i != party]
            shares[name] = jnp.stack(split(value, others, party))
        for name, shape in request.common.items():
            shares[name] = jnp.broadcast_to(next(common), (parties, *shape))
        dealt.append(uniform | dependent)
        supply.append(shares)
    return supply


class _Streams:
    """The uniform words of all parties. First come their shares of what is uniform, at the same places of all
    streams; what follows each party cuts off for itself.
    """

    def __init__(self, party_keys: Array, plan: Plan, generator: Generator):
        parties = len(party_keys)
        # One draw for all, as long as the longest; since corrections take turns, they hardly differ.
        self.length = max(words_needed(plan, parties))
        draw = functools.partial(ring.draw, shapes=[(self.length,)], generator=generator)
        (self.words,) = jax.vmap(draw)(party_keys)
        self.all_at = 0
        of_all = sum(math.prod(shape) for request in plan.requests for shape in request.uniform.values())
        self.at = [of_all] * parties

    def of_all(self, shape: Shape) -> UInt64[Array, "p ..."]:
        """The next words of all parties."""
        start, self.all_at = self.all_at, self.all_at + math.prod(shape)
        parties = len(self.at)
        return lax.slice(self.words, (0, start), (parties, self.all_at)).reshape(parties, *shape)

    def of(self, party: int, shape: Shape) -> UInt64[Array, "..."]:
        """The next words of one party."""
        start = self.at[party]
        self.at[party] += math.prod(shape)
        return lax.slice(self.words, (party, start), (party + 1, self.at[party])).reshape(shape)
