"""Truncation: from v * 2^(f + shift) to v * 2^f after a product.

| variant | error (units of the result) | bias | fails | parties | opened | rounds |
|---|---|---|---|---|---|---|
| `probabilistic` (default) | below 1 | 0 | never, for |x| < 2^62 | any | x + r | 1 |
| `nearest` | at most 1/2 | 0 (halves go up) | never, for x < 2^62 - 2^shift / 2 | any | x + r, bits | 6 |
| `floor` | below 1 | -1/2 | never, for |x| < 2^62 | any | x + r, bits | 6 |
| `wrap_count` | below P | 0 | with probability |x| / 2^64, by 2^(64 - shift) | any | every x_i + r_i | 1 |
| `local` | below 1 | 0 | with probability |x| / 2^64, by 2^(64 - shift) | 2 | nothing | 0 |

A failure puts a value of the order of the whole ring in place of a small one. With 16 fractional bits a
product of value v fails with probability |v| 2^-32: rare for one, certain over a long training. Biases are of
the truncations that do not fail. The bias of `floor` is small against every value and yet ruins training: a
weight's updates are all too low by half a unit, step after step.

All are private in that whatever is opened is uniform and independent of the secrets. In the stricter sense of
simulation `nearest`, `floor` and `local` are secure too: their result is a function of the secret, or local.
`probabilistic` and `wrap_count` are not for a functionality that rounds independently of what the parties
see: what is opened is correlated with how the result is rounded, so a party that later learns the result
learns something of the low bits of the mask (Li et al., *Efficient 3PC for binary circuits with application
to maliciously-secure DNN inference*, USENIX Security 2023, for the former).
"""

from collections.abc import Callable
from dataclasses import dataclass

import jax.numpy as jnp
from jax import Array, lax
from jaxtyping import UInt64

from ciphernav_jax import ring
from ciphernav_jax.parties import sharing
from ciphernav_jax.parties.dealer import Dealer, Dealt
from ciphernav_jax.parties.party import AXIS, from_party_zero, labelled, open_shares, open_sum
from ciphernav_jax.parties.requests import Mask, WrapCount
from ciphernav_jax.protocols import compare, convert
from ciphernav_jax.protocols.ideal import ideal_truncation
from ciphernav_jax.protocols.masked import Masked, Term

# Added before opening, so that a signed x in [-2^62, 2^62) becomes an unsigned one below 2^63.
OFFSET_BITS = 62
OFFSET = 1 << OFFSET_BITS


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


@labelled
def floor(dealer: Dealer, x: UInt64[Array, "..."], shift: int) -> Masked:
    """Exact truncation downward: floor(x / 2^shift) for a signed x in [-2^62, 2^62).

    1. - 3. as `probabilistic`, with a mask whose low bits are shared too: the result y is one too high
       exactly when those bits exceed those of c;
    4. [w] = [c mod 2^shift < r mod 2^shift] by a carry tree, converted to a ring element; subtract it.

    Opened: c, the tree's masked words and the masked bit, all uniform. Rounds: 6 for shifts of 17 to 32 (1,
    the levels of the tree, whose first the dealer pays for, 1). Correlated randomness for each value: one
    `Mask` with shift and bits, the tree's `AndTriple`s, one of `SharedBits`. Error: below 1 unit, always
    downward; bias -1/2 for an x whose low bits are uniform. Failure: none in range.
    Source: Escudero et al., CRYPTO 2020, section 5 (deterministic truncation).
    """
    mask = dealer.take(Mask(x.shape, shift, bits=shift, pairs=shift // 2))
    c = open_sum(x + mask["mask"])
    high = from_opening(c, mask, shift)
    if not shift:
        return high
    borrowed = compare.borrow(dealer, ring.bit_slice(c)[:shift], mask["bits"], pairs=mask.get("pairs"))
    bit = convert.to_ring_bit(dealer, borrowed, c.shape)
    minus = tuple(term.negated() for term in bit.terms)
    return Masked(high.public - bit.public, high.terms + minus)


@labelled
def nearest(dealer: Dealer, x: UInt64[Array, "..."], shift: int) -> Masked:
    """Exact truncation to the nearest, halves upward: `floor` of x + 2^(shift - 1). Otherwise as `floor`.

    Error: at most half a unit; bias 2^-(shift + 1) units for an x whose low bits are uniform.
    """
    half = jnp.full(x.shape, 1 << shift >> 1, jnp.uint64)
    return floor(dealer, x + from_party_zero(half), shift)


@labelled
def wrapped(dealer: Dealer, x: UInt64[Array, "..."], bits: int, *, signed: bool) -> UInt64[Array, "..."]:
    """The last `bits` bits of x, 1 to 62, as a number of their own: x modulo 2^bits, in [0, 2^bits), or with
    `signed` in [-2^(bits - 1), 2^(bits - 1)).

    1. with signed take x' = x + 2^(bits - 1), otherwise x' = x; 2. y = floor(x' / 2^bits) by `floor`;
    3. x - 2^bits [y], local.

    Opened, rounds and correlated randomness: as `floor` with a shift by `bits`. Error: none, over the whole
    ring: where `floor` fails it is off by 2^(64 - bits), which vanishes in step 3.
    """
    half = jnp.full(x.shape, 1 << bits >> 1 if signed else 0, jnp.uint64)
    return x - (floor(dealer, x + from_party_zero(half), bits).share() << bits)


@labelled
def wrap_count(dealer: Dealer, x: UInt64[Array, "..."], shift: int) -> UInt64[Array, "..."]:
    """Each party truncates its own share toward zero; what the shares' sum wraps around is counted and
    taken off. CrypTen's truncation.

    Read as signed numbers, x_0 + ... + x_{P-1} = x + 2^64 w.

    1. take r_i, uniform, known to party i alone, and [wraps of r];
    2. open every z_i = x_i + r_i mod 2^64; party i keeps b_i, whether that sum wrapped;
    3. [w] = wraps(z) + [b] - [wraps of r], unless x + r wrapped around itself;
    4. [y] = trunc(x_i / 2^shift) - 2^(64 - shift) [w].

    Opened: every z_i, uniform. Rounds: 1. Correlated randomness: one `WrapCount`. Error: below P units (one
    for each share; standard deviation sqrt(P / 3)), bias 0. Failure: with probability |x| / 2^64 the sum
    x + r wraps, and the result is off by 2^(64 - shift).
    Source: Knott et al., *CrypTen*, NeurIPS 2021, appendix C.
    """
    if not shift:
        return x
    mask = dealer.take(WrapCount(x.shape))
    z = x + mask["mask"]
    own = sharing.wraps(jnp.stack([x, mask["mask"]]))
    total = from_party_zero(sharing.wraps(open_shares(z))) + own - mask["wraps"]
    signed = lax.bitcast_convert_type(x, jnp.int64)
    toward_zero = (signed + jnp.where(signed < 0, (1 << shift) - 1, 0)) >> shift
    return lax.bitcast_convert_type(toward_zero, jnp.uint64) - (total << (64 - shift))


def from_opening(c: UInt64[Array, "..."], mask: Dealt, shift: int, offset: int = OFFSET) -> Masked:
    """Step 3 of `probabilistic` from an opened c = x + r (no offset) under a `Mask` with that shift. Local.

    It is right for -offset <= x < 2^63 - offset. With shift 0 the value is c - [r], exactly.

    Raises:
        ValueError: a shift outside 0..62; the default offset is no multiple of a larger one.
    """
    if not 0 <= shift <= OFFSET_BITS:
        raise ValueError(f"truncation shifts by 0 to {OFFSET_BITS} bits, got {shift}")
    minus_one = jnp.full(c.shape, 2**64 - 1, jnp.uint64)
    if shift == 0:
        return Masked(c, (Term(minus_one, mask["mask"], mask.ref("mask")),))
    c = c + jnp.uint64(offset)
    wrap = (c >> 63 ^ 1) << (64 - shift)
    return Masked(
        (c >> shift) - jnp.uint64(offset >> shift),
        (Term(minus_one, mask["high"], mask.ref("high")), Term(wrap, mask["top"], mask.ref("top"))),
    )


@labelled
def local(x: UInt64[Array, "..."], shift: int) -> UInt64[Array, "..."]:
    """Each of two parties shifts its own share: party 0 takes x_0 >> shift, party 1 takes -((-x_1) >> shift).

    Opened: nothing. Rounds: 0. Correlated randomness: none, as long as the shares are uniform, as those of a
    product are; others (of x - x, of a constant, of what was truncated so already) must be made so with a
    `Zero`. Error: below 1 unit and bias 0 as long as the shares wrap around as they should. Failure: with
    probability |x| / 2^64 they do not, and the result is off by 2^(64 - shift).
    Source: Mohassel and Zhang, *SecureML*, S&P 2017, section 4.1, theorem 1.

    Raises:
        ValueError: not two parties; with more the shares wrap almost surely.
    """
    parties = lax.axis_size(AXIS)
    if parties != 2:
        raise ValueError(
            f'local truncation is for two parties, got {parties}. Use Protocol(truncation="probabilistic").'
        )
    return jnp.where(lax.axis_index(AXIS) == 0, x >> shift, -((-x) >> shift))


@dataclass(frozen=True)
class Truncation:
    """A variant, as `Protocol(truncation=NAME)` chooses it.

    Attributes:
        run: `run(dealer, x, shift)`, the truncated value as `Masked`, or this party's share of it.
        of_each_party: whether each party's share errs by itself: P units and not one.
        fails: whether one in range may fail.
        parties: the most that it is for; None for any number.
        fresh_shares: whether the shares that it truncates must be uniform.
        adds_half: whether it adds half a unit first, for which there must be room.
        absorbed: whether it rounds as `from_opening`, so that a ReLU may truncate on the way (`relu`).
    """

    run: Callable[[Dealer, UInt64[Array, "..."], int], Masked | Array]
    of_each_party: bool = False
    fails: bool = False
    parties: int | None = None
    fresh_shares: bool = False
    adds_half: bool = False
    absorbed: bool = False


VARIANTS = {
    "probabilistic": Truncation(probabilistic, absorbed=True),
    "nearest": Truncation(nearest, adds_half=True),
    "floor": Truncation(floor),
    "wrap-count": Truncation(wrap_count, of_each_party=True, fails=True),
    "local": Truncation(lambda _, x, shift: local(x, shift), fails=True, parties=2, fresh_shares=True),
    "ideal": Truncation(ideal_truncation),
}
