"""Bilinear forms modulo 2^64: products that distribute over sums of either factor, whatever their shapes.

That is all that Beaver's trick needs of a product, and a dealer: so there is one protocol and one request for
all of them. A form is a hashable value, callable on ring elements.
"""

import math
from dataclasses import dataclass
from typing import ClassVar

from jax import Array
from jaxtyping import UInt64

from ciphernav_jax.ring.linear import DimensionNumbers, dot_general


@dataclass(frozen=True)
class Product:
    """x y, entry by entry, with broadcasting."""

    name: ClassVar[str] = "multiply"

    def __call__(
        self, x: UInt64[Array, "..."], y: UInt64[Array, "..."], plus: UInt64[Array, "..."] | None = None
    ) -> UInt64[Array, "..."]:
        """The product, plus something of its shape."""
        return x * y if plus is None else plus + x * y

    def count(self, shape: tuple[int, ...]) -> int:
        """How many products are added up in an entry, of a first factor of this shape."""
        return 1


@dataclass(frozen=True)
class DotProduct:
    """The tensor product of `lax.dot_general`, with its dimension numbers."""

    name: ClassVar[str] = "dot_general"
    dimension_numbers: DimensionNumbers

    def __call__(
        self, x: UInt64[Array, "..."], y: UInt64[Array, "..."], plus: UInt64[Array, "..."] | None = None
    ) -> UInt64[Array, "..."]:
        """The product, plus something of its shape."""
        return dot_general(x, y, self.dimension_numbers, plus)

    def count(self, shape: tuple[int, ...]) -> int:
        """How many products are added up in an entry, of a first factor of this shape."""
        return math.prod(shape[axis] for axis in self.dimension_numbers[0][0])


Form = Product | DotProduct

TIMES = Product()
