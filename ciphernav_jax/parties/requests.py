"""What a program asks the dealer for: the kinds of correlated randomness."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import jax.numpy as jnp
from jax import Array
from jaxtyping import UInt64

from ciphernav_jax import ring
from ciphernav_jax.parties import sharing
from ciphernav_jax.ring import bits
from ciphernav_jax.ring.forms import Form

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
    def kind(self) -> str:
        """The name under which its words are counted."""
        return type(self).__name__

    @cached_property
    def uniform(self) -> dict[str, Shape]:
        return {}

    @cached_property
    def own(self) -> frozenset[str]:
        return frozenset()

    @cached_property
    def common(self) -> dict[str, Shape]:
        return {}

    @cached_property
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

    @cached_property
    def binary(self) -> frozenset[str]:
        return frozenset({"bits", "pairs"})

    @cached_property
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

    @cached_property
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

    @cached_property
    def uniform(self) -> dict[str, Shape]:
        return {"mask": self.shape}

    @cached_property
    def own(self) -> frozenset[str]:
        return frozenset({"mask"})

    def deal(self, uniform: Values, earlier: Sequence[Values]) -> Values:
        return {"wraps": sharing.wraps(uniform["mask"])}


@dataclass(frozen=True)
class Bilinear(Request):
    """A product, of some form, of two earlier values modulo 2^64: {"product": its shape}. Nothing of it is
    uniform. With its two factors it is a Beaver triple (Beaver, CRYPTO 1991).
    """

    left: Ref
    right: Ref
    form: Form

    @property
    def kind(self) -> str:
        return type(self.form).__name__

    def deal(self, uniform: Values, earlier: Sequence[Values]) -> Values:
        left, right = (earlier[ref.request][ref.name] for ref in (self.left, self.right))
        return {"product": self.form(left, right)}


@dataclass(frozen=True)
class SharedBits(Request):
    """Uniform bits shared both ways: {"words": [*rows, B]}, 64 bits to a word, by exclusive or, and {"bits":
    [*rows, *shape]}, values 0 or 1, additively (daBits: Rotaru and Wood, INDOCRYPT 2019). Uniform: words.
    """

    shape: Shape
    rows: Shape = ()

    @cached_property
    def binary(self) -> frozenset[str]:
        return frozenset({"words"})

    @cached_property
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

    @cached_property
    def binary(self) -> frozenset[str]:
        return frozenset({"left", "right", "product"})

    @cached_property
    def uniform(self) -> dict[str, Shape]:
        return {"left": self.shape, "right": (self.count, *self.shape)}

    def deal(self, uniform: Values, earlier: Sequence[Values]) -> Values:
        return {"product": uniform["left"][None] & uniform["right"]}
