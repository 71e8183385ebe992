"""ReLU, and selection by a secret bit."""

from typing import NamedTuple

from jax import Array
from jaxtyping import UInt64

from ciphernav_jax.parties.dealer import Dealer
from ciphernav_jax.parties.party import labelled, open_sum
from ciphernav_jax.protocols import compare, truncate
from ciphernav_jax.protocols.masked import Masked
from ciphernav_jax.protocols.multiply import bilinear
from ciphernav_jax.ring import TIMES


class Relu(NamedTuple):
    """Of z = x + plus: a party's share of max(z, 0) after truncation, and the bit z > 0, for the backward
    pass. Of x: what it truncates to by the same opening, which is right for |x| < 2^62; and where x < 0.
    """

    output: UInt64[Array, "..."]
    positive: Masked
    truncated: Masked
    below: Masked


@labelled
def relu(
    dealer: Dealer,
    x: UInt64[Array, "..."],
    shift: int = 0,
    circuit: compare.Circuit = compare.DEFAULT,
    plus: UInt64[Array, "..."] | None = None,
) -> Relu:
    """max(z, 0) / 2^shift and the bit z > 0 of z = x + plus, a public number that 2^shift divides (0 where it
    is None), from one opening of x.

    1. take [r], its bits, and [r >> shift], [r >> 63]; 2. open c = [x] + [r];
    3. from c + plus and those, locally, the truncated value z / 2^shift as a `Masked` value, right for z >= 0
       (`truncate.from_opening` without an offset);
    4. from c + plus and the bits of r the bit b = (z > 0), again `Masked` (`compare.positive`);
    5. [b z / 2^shift] is the product of two `Masked` values: the dealer's products, no opening.

    From c, locally, x / 2^shift as well, with the same rounding: where z > 0 it is b z / 2^shift less
    plus / 2^shift. So whoever needs x truncated has it without another opening.

    Opened: what `compare.positive` opens. Rounds: 7 by default. Correlated randomness for each value: one
    `Mask` with bits and shift, 31 bit `AndTriple`s, one of `SharedBits`, two `Bilinear` (one with shift 0).
    Error: that of the truncation, below 1 unit of the result and unbiased; with shift 0 none. Valid for |z| <
    2^63, twice as far as a truncation alone: where z < 0 the truncated value is wrong, but the bit is 0 and
    the output exactly 0; so a positive z may have the offset's half of the ring as well.
    """
    mask = dealer.take(circuit.mask(x.shape, shift))
    c = open_sum(x + mask["mask"])
    z = c if plus is None else c + plus
    positive = compare.positive_from_opening(dealer, z, mask, circuit)
    above = truncate.from_opening(z, mask, shift, offset=0)
    return Relu(
        bilinear(dealer, positive, above, TIMES),
        positive,
        truncated=truncate.from_opening(c, mask, shift),
        below=truncate.from_opening(c, mask, shift, offset=1 << 63),
    )
