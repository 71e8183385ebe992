"""Truncation: from v * 2^(f + shift) to v * 2^f after a product.

| variant | error (units of the result) | bias | fails | parties | opened |
|---|---|---|---|---|---|
| `probabilistic` (default) | below 1 | 0 | never, for |x| < 2^62 | any | x + r, uniform |
| `local` | below 1 | 0 | with probability |x| / 2^64, by 2^(64 - shift) | 2 | nothing |

A failed local truncation puts a value of the order of the whole ring in place of a small one. With 16
fractional bits a product of value v fails with probability |v| 2^-32: rare for one, certain over a long
training. Its bias of 0 is that of the truncations that do not fail.
"""

import jax.numpy as jnp
from jax import Array, lax
from jaxtyping import UInt64

from ciphernav_jax.protocols.dealer import Dealer, Dealt, Mask
from ciphernav_jax.protocols.masked import Masked, Term
from ciphernav_jax.protocols.party import AXIS, labelled, open_sum

# Added before opening, so that a signed x in [-2^62, 2^62) becomes an unsigned one below 2^63.
OFFSET_BITS = 62


@labelled
def probabilistic(dealer: Dealer, x: UInt64[Array, "..."], shift: int) -> Masked:
    """Unbiased truncation: floor or ceiling of x / 2^shift, with the right probabilities.

    For a signed x in [-2^62, 2^62), let x' = x + 2^62, so 0 <= x' < 2^63.

    1. take [r], [R] = [r >> shift], [t] = [r >> 63], r uniform modulo 2^64;
    2. open c = [x'] + [r] mod 2^64;
    3. the sum wrapped around if and only if t = 1 and the top bit of c is 0 (as x' < 2^63), so
       [y] = (c >> shift) - [R] + (1 - c_63) 2^(64 - shift) [t] - 2^(62 - shift).

    Then y = floor(x / 2^shift) + u with u = 1 exactly when the low `shift` bits of x' and r carry, which has
    probability (x mod 2^shift) / 2^shift: E[y] = x / 2^shift.

    Opened: c, uniform and independent of x. Rounds: 1. Correlated randomness: one `Mask` with its shift.
    Error: |y - x / 2^shift| < 1, bias 0. Failure: none for |x| < 2^62, whatever the number of parties;
    beyond, the result is wrong. Not simulatable as a functionality with independent rounding: u is a function
    of the opened c and of x, so a party that later learns y learns something of the low bits of r (Li et al.,
    2023).
    Source: Escudero, Ghosh, Keller, Rachuri, Scholl, *Improved primitives for MPC over mixed
    arithmetic-binary circuits*, CRYPTO 2020, section 5; Dalskov, Escudero, Keller, PoPETs 2020.
    """
    mask = dealer.take(Mask(x.shape, shift))
    return from_opening(open_sum(x + mask["mask"]), mask, shift)


def from_opening(c: UInt64[Array, "..."], mask: Dealt, shift: int) -> Masked:
    """Step 3 of `probabilistic` from an opened c = x + r (no offset) under a `Mask` with that shift. Local.

    With shift 0 the value is c - [r], exactly.

    Raises:
        ValueError: a shift outside 0..62; the offset is no multiple of a larger one.
    """
    if not 0 <= shift <= OFFSET_BITS:
        raise ValueError(f"truncation shifts by 0 to {OFFSET_BITS} bits, got {shift}")
    minus_one = jnp.full(c.shape, 2**64 - 1, jnp.uint64)
    if shift == 0:
        return Masked(c, (Term(minus_one, mask["mask"], mask.ref("mask")),))
    c = c + (jnp.uint64(1) << OFFSET_BITS)
    wrap = (c >> 63 ^ 1) << (64 - shift)
    return Masked(
        (c >> shift) - (jnp.uint64(1) << (OFFSET_BITS - shift)),
        (Term(minus_one, mask["high"], mask.ref("high")), Term(wrap, mask["top"], mask.ref("top"))),
    )


@labelled
def local(x: UInt64[Array, "..."], shift: int) -> UInt64[Array, "..."]:
    """Each of two parties shifts its own share: party 0 takes x_0 >> shift, party 1 takes -((-x_1) >> shift).

    Opened: nothing. Rounds: 0. Correlated randomness: none. Error: below 1
    unit and bias 0 as long as the shares wrap around as they should. Failure: with probability |x| / 2^64
    they do not, and the result is off by 2^(64 - shift).
    Source: Mohassel and Zhang, *SecureML*, S&P 2017,
    section 4.1, theorem 1.

    Raises:
        ValueError: not two parties; with more the shares wrap almost surely.
    """
    parties = lax.axis_size(AXIS)
    if parties != 2:
        raise ValueError(
            f'local truncation is for two parties, got {parties}. Use Protocol(truncation="probabilistic").'
        )
    return jnp.where(lax.axis_index(AXIS) == 0, x >> shift, -((-x) >> shift))
