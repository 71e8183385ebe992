"""The sign of a shared value by bit decomposition, from one opening under a mask whose bits are shared.

With c = x + r open, x = c - r is negative exactly when the top bit of c - r is 1: the top bits of c and r,
and the borrow that the lower 63 bits hand up. That borrow is a comparison of public with shared bits. Bits
are sliced (64 values to a word) and the borrow is found by a carry tree (a Kogge-Stone prefix network that
keeps only what the last position needs).
"""

import jax.numpy as jnp
from jax import Array
from jaxtyping import UInt64

from ciphernav_jax import ring
from ciphernav_jax.protocols import convert
from ciphernav_jax.protocols.dealer import Dealer, Dealt, Mask
from ciphernav_jax.protocols.masked import Masked
from ciphernav_jax.protocols.multiply import conjunction
from ciphernav_jax.protocols.party import from_party_zero, labelled, open_sum


@labelled
def positive(dealer: Dealer, x: UInt64[Array, "..."]) -> Masked:
    """The bit x > 0 (1 or 0, additively shared) of a signed x.

    1. take [r] and its bits; 2. open c = [x] + [r]; 3. `positive_from_opening`.

    Opened: c, the carry tree's masked words, and the masked bit; all uniform. Rounds: 7 (opening, 5 levels of
    the tree, conversion of the bit). Correlated randomness for each value: one `Mask` with bits, 31
    bit `AndTriple`s, one of `SharedBits`. Error: none, over the whole ring but -2^63.
    """
    mask = dealer.take(Mask(x.shape, bits=True))
    return positive_from_opening(dealer, open_sum(x + mask["mask"]), mask)


def positive_from_opening(dealer: Dealer, c: UInt64[Array, "..."], mask: Dealt) -> Masked:
    """The bit x > 0 from an opened c = x + r, where `mask` shares the bits of r.

    x > 0 means x - 1 >= 0 in units of the last place: the top bit of (c - 1) - r is 0.
    """
    public, shared = ring.bit_slice(c - 1), mask["bits"]
    borrow = _borrow(dealer, public, shared, mask["pairs"])
    positive_word = shared[63] ^ borrow ^ from_party_zero(~public[63])
    return convert.to_ring_bit(dealer, positive_word, c.shape)


def _borrow(
    dealer: Dealer,
    public: UInt64[Array, "64 b"],
    shared: UInt64[Array, "64 b"],
    pairs: UInt64[Array, "32 b"],
) -> UInt64[Array, " b"]:
    """[public mod 2^63 < shared mod 2^63] as words shared by exclusive or.

    A position generates a borrow (g) where public is 0 and shared is 1, and hands one on (p) where the two
    are equal. Neighbours combine as (g, p) = (g_hi ^ p_hi g_lo, p_hi p_lo). At the first level both products
    need only the product of two bits of r, which the dealer has shared (`pairs`); each further level is one
    opening.
    """
    c_low, c_high = public[0::2], public[1::2]
    r_low, r_high = shared[0::2], shared[1::2]
    # p_hi = r_hi ^ ~c_hi, g_lo = ~c_lo & r_lo, p_lo = r_lo ^ ~c_lo, multiplied out.
    p_high_r_low = pairs ^ (~c_high & r_low)
    g = (~c_high & r_high) ^ (~c_low & p_high_r_low)
    p = p_high_r_low ^ (~c_low & r_high) ^ from_party_zero(~c_low & ~c_high)
    # Bit 63 takes no part: the last pair is bit 62 alone.
    g = g.at[31].set(~c_low[31] & r_low[31])
    p = p.at[31].set(r_low[31] ^ from_party_zero(~c_low[31]))
    while len(g) > 1:
        g_low, g_high, p_low, p_high = g[0::2], g[1::2], p[0::2], p[1::2]
        if len(g) > 2:
            carried, p = conjunction(dealer, p_high, jnp.stack([g_low, p_low]))
        else:
            (carried,) = conjunction(dealer, p_high, g_low[None])
        g = g_high ^ carried
    return g[0]
