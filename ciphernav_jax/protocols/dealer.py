"""Correlated randomness from a trusted dealer: what a program asks for, the plan of it, and its generation.

A program asks for randomness through `Dealer.take(request)`, and gets its own shares of the dealer's values.
Tracing the program once with a `Planner` lists all requests without computing anything; `deal` then makes the
randomness of the whole program from few large uniform draws; a `Supply` hands it to the party. So the dealer
acts before the program starts (the offline phase), and the online phase holds no dealer at all: in
a deployment each party's part of the supply is its own input.

The dealer is trusted, takes part in nothing else, and must not collude with a party.
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple, Protocol

import jax
import jax.numpy as jnp
from jax import Array
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


class Request(ABC):
    """One kind of correlated randomness; a frozen dataclass.

    `draws` are the shapes of the independent uniform words it starts from, `deal` computes from them (and
    from the values of earlier requests) the values to be shared. Names in `binary` are shared by exclusive
    or, those in `split` are shares already, the party as leading axis; the others are shared additively.
    """

    @property
    def binary(self) -> frozenset[str]:
        return frozenset()

    @property
    def split(self) -> frozenset[str]:
        return frozenset()

    @property
    def draws(self) -> tuple[Shape, ...]:
        return ()

    @abstractmethod
    def deal(self, draws: Sequence[Array], earlier: Sequence[Values]) -> Values: ...


@dataclass(frozen=True)
class Mask(Request):
    """A uniform ring element r for each entry, {"mask": shape}, and what its truncation and bits need.

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
    def draws(self) -> tuple[Shape, ...]:
        sliced = self.bits and not self.words
        return ((64, bits.columns(math.prod(self.shape))) if sliced else self.shape,)

    def deal(self, draws: Sequence[Array], earlier: Sequence[Values]) -> Values:
        (r,) = draws
        values = {}
        if self.bits and self.words:
            values["bits"] = r
        elif self.bits:
            values["bits"] = r[: self.bits]
            if self.pairs:
                values["pairs"] = r[0 : 2 * self.pairs : 2] & r[1 : 2 * self.pairs : 2]
            r = ring.bit_unslice(r, self.shape)
        values["mask"] = r
        if self.shift:
            values |= {"high": r >> self.shift, "top": r >> 63}
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

    def deal(self, draws: Sequence[Array], earlier: Sequence[Values]) -> Values:
        return {"zero": jnp.zeros(self.shape, jnp.uint64)}


@dataclass(frozen=True)
class WrapCount(Request):
    """A uniform r_i for each party, {"mask": shape}, and how often their signed sum wraps around,
    {"wraps": shape}, additively shared: sum r_i = (sum r_i mod 2^64) + 2^64 wraps, all read as signed.
    """

    shape: Shape
    parties: int

    @property
    def split(self) -> frozenset[str]:
        return frozenset({"mask"})

    @property
    def draws(self) -> tuple[Shape, ...]:
        return ((self.parties, *self.shape),)

    def deal(self, draws: Sequence[Array], earlier: Sequence[Values]) -> Values:
        (r,) = draws
        return {"mask": r, "wraps": sharing.wraps(r)}


@dataclass(frozen=True)
class _OfTwo(Request):
    """A request for something of two earlier values, which draws nothing of its own."""

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

    def deal(self, draws: Sequence[Array], earlier: Sequence[Values]) -> Values:
        left, right = self.factors(earlier)
        return {"product": left * right}


@dataclass(frozen=True)
class DotProduct(_OfTwo):
    """`dot_general` of two earlier values modulo 2^64: {"product": its shape}. A Beaver triple of tensors."""

    dimension_numbers: DimensionNumbers

    def deal(self, draws: Sequence[Array], earlier: Sequence[Values]) -> Values:
        left, right = self.factors(earlier)
        return {"product": ring.dot_general(left, right, self.dimension_numbers)}


@dataclass(frozen=True)
class SharedBits(Request):
    """Uniform bits shared both ways: {"words": [*rows, B]}, 64 bits to a word, by exclusive or, and {"bits":
    [*rows, *shape]}, values 0 or 1, additively (daBits: Rotaru and Wood, INDOCRYPT 2019).
    """

    shape: Shape
    rows: Shape = ()

    @property
    def binary(self) -> frozenset[str]:
        return frozenset({"words"})

    @property
    def draws(self) -> tuple[Shape, ...]:
        return ((*self.rows, bits.columns(math.prod(self.shape))),)

    def deal(self, draws: Sequence[Array], earlier: Sequence[Values]) -> Values:
        return {"words": draws[0], "bits": bits.unpack(draws[0], self.shape)}


@dataclass(frozen=True)
class AndTriple(Request):
    """Words a, b and a & b for the conjunction of one word with several: {"left": shape},
    {"right": [count, *shape]}, {"product": [count, *shape]}, all shared by exclusive or.
    """

    shape: Shape
    count: int

    @property
    def binary(self) -> frozenset[str]:
        return frozenset({"left", "right", "product"})

    @property
    def draws(self) -> tuple[Shape, ...]:
        return (self.shape, (self.count, *self.shape))

    def deal(self, draws: Sequence[Array], earlier: Sequence[Values]) -> Values:
        left, right = draws
        return {"left": left, "right": right, "product": left[None] & right}


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
    """All requests of a program in order, and the shapes of the values that each one deals."""

    requests: tuple[Request, ...]
    shapes: tuple[dict[str, Shape], ...]


@dataclass
class Planner:
    """A dealer that notes what a program asks for and hands out zeros. Use it under `jax.eval_shape`."""

    requests: list[Request] = field(default_factory=list)
    values: list[dict[str, jax.ShapeDtypeStruct]] = field(default_factory=list)

    def take(self, request: Request) -> Dealt:
        draws = [jax.ShapeDtypeStruct(shape, jnp.uint64) for shape in request.draws]
        values = jax.eval_shape(request.deal, draws, self.values)
        self.requests.append(request)
        self.values.append(values)
        zeros = {
            name: jnp.zeros(value.shape[1:] if name in request.split else value.shape, jnp.uint64)
            for name, value in values.items()
        }
        return Dealt(len(self.requests) - 1, zeros)

    def plan(self) -> Plan:
        shapes = tuple({name: value.shape for name, value in values.items()} for values in self.values)
        return Plan(tuple(self.requests), shapes)


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


def drawn(plan: Plan, parties: int) -> list[Shape]:
    """The shapes of all the uniform words that `deal` draws, in its order: for each request those it starts
    from, then P - 1 shares of each value that is not split already.
    """
    shapes: list[Shape] = []
    for request, values in zip(plan.requests, plan.shapes, strict=True):
        to_share = (shape for name, shape in values.items() if name not in request.split)
        shapes += [*request.draws, *((parties - 1, *shape) for shape in to_share)]
    return shapes


def deal(
    key: Array, plan: Plan, parties: int, generator: Generator = "threefry"
) -> list[dict[str, UInt64[Array, "p ..."]]]:
    """The offline phase: all correlated randomness of a plan, as shares of `parties` parties.

    Every value v that is shared takes P - 1 uniform arrays u_1 ... u_{P-1}; party 0 gets v - sum(u), or v ^
    u_1 ^ ..., party i gets u_i. All uniform words of the plan come from one draw.

    Returns:
        For each request a dict of uint64 arrays with the party as leading axis.
    """
    sharing.require_parties(parties)
    uniform = iter(ring.draw(keys.derive(key, "dealer"), drawn(plan, parties), generator))

    def split(request: Request, name: str, value: Array) -> Array:
        if name in request.split:
            return value
        return (sharing.split_xor if name in request.binary else sharing.split_sum)(value, next(uniform))

    dealt: list[Values] = []
    supply: list[Values] = []
    for request, names in zip(plan.requests, plan.shapes, strict=True):
        values = request.deal([next(uniform) for _ in request.draws], dealt)
        dealt.append(values)
        supply.append({name: split(request, name, values[name]) for name in names})
    return supply
