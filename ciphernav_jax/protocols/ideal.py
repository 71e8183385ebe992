"""The *ideal* variants: a trusted third party reconstructs, computes, and shares afresh. **Not protocols.**

The result has the distribution that a real protocol gives: uniform shares, and for the truncation the same
random rounding. They show what a function gives without what it costs, for sweeps; the third party would see
every value. Nothing of them is counted as a message.
"""

import jax.numpy as jnp
from jax import Array, lax
from jaxtyping import UInt64

from ciphernav_jax.parties.dealer import Dealer
from ciphernav_jax.parties.party import from_party_zero, ideal_sum, labelled
from ciphernav_jax.parties.requests import Mask, Zero
from ciphernav_jax.ring.forms import Form


@labelled
def ideal_product(
    dealer: Dealer,
    x: UInt64[Array, "..."],
    y: UInt64[Array, "..."],
    form: Form,
) -> UInt64[Array, "..."]:
    """Fresh shares of a product of any form, as `multiply.bilinear` gives them. Error: none."""
    return _afresh(dealer, form(ideal_sum(x), ideal_sum(y)))


@labelled
def ideal_positive(dealer: Dealer, x: UInt64[Array, "..."]) -> UInt64[Array, "..."]:
    """Fresh shares of the bit x > 0 of a signed x. Error: none."""
    positive = lax.bitcast_convert_type(ideal_sum(x), jnp.int64) > 0
    return _afresh(dealer, positive.astype(jnp.uint64))


@labelled
def ideal_truncation(dealer: Dealer, x: UInt64[Array, "..."], shift: int) -> UInt64[Array, "..."]:
    """Fresh shares of floor(x / 2^shift + u), u uniform in [0, 1): the rounding of `truncate.probabilistic`.

    Error: below 1 unit, bias 0; no failure over the whole ring.
    """
    u = ideal_sum(dealer.take(Mask(x.shape))["mask"])
    signed, low = lax.bitcast_convert_type(ideal_sum(x), jnp.int64), (jnp.uint64(1) << shift) - 1
    carry = ((lax.bitcast_convert_type(signed, jnp.uint64) & low) + (u & low)) >> shift
    floor = lax.bitcast_convert_type(signed >> shift, jnp.uint64)
    return _afresh(dealer, floor + carry)


def _afresh(dealer: Dealer, x: UInt64[Array, "..."]) -> UInt64[Array, "..."]:
    return dealer.take(Zero(x.shape))["zero"] + from_party_zero(x)
