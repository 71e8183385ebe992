"""Correlated randomness from a trusted dealer: what a program asks for, the plan of it, and its generation.

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
from typing import Any, NamedTuple, Protocol

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, lax
from jaxtyping import UInt64

from ciphernav_jax import ring
from ciphernav_jax.jax_private import get_opaque_trace_state
from ciphernav_jax.protocols import sharing
from ciphernav_jax.ring import bits, keys
from ciphernav_jax.ring.linear import DimensionNumbers
from ciphernav_jax.ring.random import Generator

Shape = tuple[int, ...]
Values = dict[str, Array]


class Ref(NamedTuple):
    """Names one of the dealer's values: the number of the request, and the value's name in it."""

    request: int
    name: str


class Request:
    """One kind of correlated randomness; a frozen dataclass. Its values are of three kinds:

    - `uniform`: words that depend on nothing. Every party draws its share from a stream of its own, and the
      value *is* the sum of the shares (or their exclusive or): the dealer, who knows all streams, sends
      nothing. Those in `own` are no shares: each party has words of its own.
    - what `deal` computes from these, and from the values of earlier requests. All parties but one draw their
      shares; the dealer sends that one the rest, its correction.
    - `common`: words that the dealer draws, and sends to all.

    Names in `binary` are shared by exclusive or, the others additively.
    """

    @property
    def uniform(self) -> dict[str, Shape]:
        return {}

    @property
    def own(self) -> frozenset[str]:
        return frozenset()

    @property
    def common(self) -> dict[str, Shape]:
        return {}

    @property
    def binary(self) -> frozenset[str]:
        return frozenset()

    def deal(self, uniform: Values, earlier: Sequence[Values]) -> Values:
        """The values that depend on others. What is in `own` has the party as leading axis."""
        return {}

    def join(self, name: str, shares: UInt64[Array, "p ..."]) -> Array:
        """The value that the parties' shares give; all of them, if they are the parties' own."""
        if name in self.own:
            return shares
        return (sharing.join_xor if name in self.binary else sharing.join_sum)(shares)


@dataclass(frozen=True)
class Mask(Request):
    """A uniform ring element r for each entry, {"mask": shape}, and what its truncation and bits need.
    Uniform: mask; all else depends on it.

    - shift > 0 adds the high part and the top bit, {"high": r >> shift, "top": r >> 63}, additively shared
      (Escudero et al., CRYPTO 2020).
    - bits adds the low `bits` bits of r, shared by exclusive or: sliced, 64 values to a word, {"bits": [bits,
      B]}; or with `words` in words of their own, {"bits": shape}.
    - pairs adds the products of the first even bits with their odd neighbours, sliced, {"pairs": [pairs, B]}:
      the first level of a comparison circuit then needs no communication.
    """

    shape: Shape
    shift: int = 0
    bits: int = 0
    pairs: int = 0
    words: bool = False

    @property
    def binary(self) -> frozenset[str]:
        return frozenset({"bits", "pairs"})

    @property
    def uniform(self) -> dict[str, Shape]:
        return {"mask": self.shape}

    def deal(self, uniform: Values, earlier: Sequence[Values]) -> Values:
        r = uniform["mask"]
        values = {}
        if self.shift:
            values |= {"high": r >> self.shift, "top": r >> 63}
        if self.bits and self.words:
            values["bits"] = r
        elif self.bits:
            sliced = ring.bit_slice(r)
            values["bits"] = sliced[: self.bits]
            if self.pairs:
                values["pairs"] = sliced[0 : 2 * self.pairs : 2] & sliced[1 : 2 * self.pairs : 2]
        return values


@dataclass(frozen=True)
class Zero(Request):
    """Shares of nothing, {"zero": shape}: they make the shares of another value fresh.

    Shared additively, or by exclusive or with `xor`.
    """

    shape: Shape
    xor: bool = False

    @property
    def binary(self) -> frozenset[str]:
        return frozenset({"zero"} if self.xor else ())

    def deal(self, uniform: Values, earlier: Sequence[Values]) -> Values:
        return {"zero": jnp.zeros(self.shape, jnp.uint64)}


@dataclass(frozen=True)
class WrapCount(Request):
    """A uniform r_i for each party, {"mask": shape}, and how often their signed sum wraps around,
    {"wraps": shape}, additively shared: sum r_i = (sum r_i mod 2^64) + 2^64 wraps, all read as signed.
    Uniform, and each party's own: mask.
    """

    shape: Shape

    @property
    def uniform(self) -> dict[str, Shape]:
        return {"mask": self.shape}

    @property
    def own(self) -> frozenset[str]:
        return frozenset({"mask"})

    def deal(self, uniform: Values, earlier: Sequence[Values]) -> Values:
        return {"wraps": sharing.wraps(uniform["mask"])}


@dataclass(frozen=True)
class _OfTwo(Request):
    """A request for something of two earlier values: nothing of it is uniform."""

    left: Ref
    right: Ref

    def factors(self, earlier: Sequence[Values]) -> tuple[Array, Array]:
        left, right = (earlier[ref.request][ref.name] for ref in (self.left, self.right))
        return left, right


@dataclass(frozen=True)
class Product(_OfTwo):
    """The elementwise product, with broadcasting, of two earlier values: {"product": broadcast shape}.

    With its two factors it is a Beaver triple (Beaver, CRYPTO 1991).
    """

    def deal(self, uniform: Values, earlier: Sequence[Values]) -> Values:
        left, right = self.factors(earlier)
        return {"product": left * right}


@dataclass(frozen=True)
class DotProduct(_OfTwo):
    """`dot_general` of two earlier values modulo 2^64: {"product": its shape}. A Beaver triple of tensors."""

    dimension_numbers: DimensionNumbers

    def deal(self, uniform: Values, earlier: Sequence[Values]) -> Values:
        left, right = self.factors(earlier)
        return {"product": ring.dot_general(left, right, self.dimension_numbers)}


@dataclass(frozen=True)
class SharedBits(Request):
    """Uniform bits shared both ways: {"words": [*rows, B]}, 64 bits to a word, by exclusive or, and {"bits":
    [*rows, *shape]}, values 0 or 1, additively (daBits: Rotaru and Wood, INDOCRYPT 2019). Uniform: words.
    """

    shape: Shape
    rows: Shape = ()

    @property
    def binary(self) -> frozenset[str]:
        return frozenset({"words"})

    @property
    def uniform(self) -> dict[str, Shape]:
        return {"words": (*self.rows, bits.columns(math.prod(self.shape)))}

    def deal(self, uniform: Values, earlier: Sequence[Values]) -> Values:
        return {"bits": bits.unpack(uniform["words"], self.shape)}


@dataclass(frozen=True)
class AndTriple(Request):
    """Words a, b and a & b for the conjunction of one word with several: {"left": shape},
    {"right": [count, *shape]}, {"product": [count, *shape]}, all shared by exclusive or. Uniform: the first
    two.
    """

    shape: Shape
    count: int

    @property
    def binary(self) -> frozenset[str]:
        return frozenset({"left", "right", "product"})

    @property
    def uniform(self) -> dict[str, Shape]:
        return {"left": self.shape, "right": (self.count, *self.shape)}

    def deal(self, uniform: Values, earlier: Sequence[Values]) -> Values:
        return {"product": uniform["left"][None] & uniform["right"]}


class Dealt(NamedTuple):
    """What a party receives for one request: its shares by name, and the request's number."""

    request: int
    shares: Values

    def __getitem__(self, name: str) -> Array:  # pyright: ignore[reportIncompatibleMethodOverride]
        return self.shares[name]

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
