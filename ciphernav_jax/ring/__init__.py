"""Arithmetic of Z_2^64, the integers modulo 2^64; it knows nothing of parties.

Ring elements are uint64 arrays, so `+`, `-`, `*` and unary `-` are already the ring's own.

- `fixed_point`: floats to ring elements and back.
- `linear`: matrix products and `dot_general` modulo 2^64.
- `forms`: products of any shape that distribute over sums.
- `bits`: bit slicing, the most significant bit.
- `threefry`, `chacha`: the block functions of two generators.
- `keys`: a run's root key, and a key for each purpose derived from it.
- `random`: uniform ring elements, many arrays from one draw.
"""

from ciphernav_jax.ring import keys
from ciphernav_jax.ring.bits import bit_slice, bit_unslice, most_significant_bit
from ciphernav_jax.ring.fixed_point import (
    POISON,
    decode,
    encode,
    encode_or_poison,
    fits,
    require_x64,
    value_range,
)
from ciphernav_jax.ring.forms import TIMES, DotProduct
from ciphernav_jax.ring.linear import dot_general, matmul
from ciphernav_jax.ring.random import draw

__all__ = [
    "POISON",
    "TIMES",
    "DotProduct",
    "bit_slice",
    "bit_unslice",
    "decode",
    "dot_general",
    "draw",
    "encode",
    "encode_or_poison",
    "fits",
    "keys",
    "matmul",
    "most_significant_bit",
    "require_x64",
    "value_range",
]
