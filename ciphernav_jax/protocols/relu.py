"""ReLU, and selection by a secret bit."""

from typing import NamedTuple

from jax import Array
from jaxtyping import UInt64

from ciphernav_jax.protocols import compare, truncate
from ciphernav_jax.protocols.dealer import Dealer
from ciphernav_jax.protocols.masked import Masked
from ciphernav_jax.protocols.multiply import multiply
from ciphernav_jax.protocols.party import labelled, open_sum


class Relu(NamedTuple):
    """A party's share of max(x, 0) after truncation, and the bit x > 0 for the backward pass."""

    output: UInt64[Array, "..."]
    positive: Masked


@labelled
def relu(
    dealer: Dealer,
    x: UInt64[Array, "..."],
    shift: int = 0,
    circuit: compare.Circuit = compare.DEFAULT,
) -> Relu:
    """max(x, 0) / 2^shift and the bit x > 0, from one opening of x.

    1. take [r], its bits, and [r >> shift], [r >> 63]; 2. open c = [x] + [r];
    3. from c and those, locally, the truncated value x / 2^shift as a `Masked` value, right for x >= 0
       (`truncate.from_opening` without an offset);
    4. from c and the bits of r the bit b = (x > 0), again `Masked` (`compare.positive`);
    5. [b x / 2^shift] is the product of two `Masked` values: the dealer's products, no opening.

    Opened: what `compare.positive` opens. Rounds: 7 by default. Correlated randomness for each value: one
    `Mask` with bits and shift, 31 bit `AndTriple`s, one of `SharedBits`, two `Product`s (one with shift 0).
    Error: that of the truncation, below 1 unit of the result and unbiased; with shift 0 none. Valid for |x| <
    2^63, twice as far as a truncation alone: where x < 0 the truncated value is wrong, but the bit is 0 and
    the output exactly 0; so a positive x may have the offset's half of the ring as well.
    """
    mask = dealer.take(circuit.mask(x.shape, shift))
    c = open_sum(x + mask["mask"])
    positive = compare.positive_from_opening(dealer, c, mask, circuit)
    truncated = truncate.from_opening(c, mask, shift, offset=0)
    return Relu(multiply(dealer, positive, truncated), positive)
