"""The sign of a shared value by bit decomposition.

| variant | opened | rounds (P = 2, 5) | bits | adders |
|---|---|---|---|---|
| `masked`, sliced (default) | x + r, masked words | 7, 7 | 64 values to a word | all |
| `masked`, words | the same | 8, 8 | a word for each value | all |
| `resharing` | masked words | 8, 22 | 64 values to a word | all |
| `ideal` | by a trusted third party | - | - | - |

All are exact. Masked opening: with c = x + r open, x = c - r is negative exactly when the top bit of c - r is
1: the top bits of c and r, and the borrow that the lower bits hand up. That borrow is a comparison of public
with shared bits (edaBits: Escudero et al., CRYPTO 2020). Re-sharing is CrypTen's way (Knott et al., NeurIPS
2021, appendix C): every party shares the bits of its own share, and binary adders over the parties add
them up.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import jax.numpy as jnp
import numpy as np
from jax import Array, lax
from jaxtyping import UInt64

from ciphernav_jax import ring
from ciphernav_jax.parties.dealer import Dealer, Dealt
from ciphernav_jax.parties.party import AXIS, from_party_zero, labelled, open_sum
from ciphernav_jax.parties.requests import Mask, Zero
from ciphernav_jax.protocols import adders, convert
from ciphernav_jax.protocols.ideal import ideal_positive
from ciphernav_jax.protocols.masked import Masked
from ciphernav_jax.protocols.multiply import conjunction
from ciphernav_jax.protocols.suite import Adder
from ciphernav_jax.ring import bits


@dataclass(frozen=True)
class Circuit:
    """How a sign is found from bits.

    Attributes:
        layout: "sliced" (a word holds one bit of 64 values) or "words" (a word holds the bits of one value).
        adder: the network that finds the borrow; see `adders`.
        sign_bit: the position of the bit that tells the sign, 1 to 63. Below 63 the values must lie in
            (-2^sign_bit, 2^sign_bit]; the sign of others is wrong.
    """

    layout: Literal["sliced", "words"] = "sliced"
    adder: Adder = "carry-tree"
    sign_bit: int = 63

    def mask(self, shape: tuple[int, ...], shift: int = 0) -> Mask:
        """The mask under which a value is opened for this circuit, and for a truncation by `shift`."""
        words = self.layout == "words"
        pairs = self.sign_bit // 2 if self.adder == "carry-tree" and not words else 0
        return Mask(shape, shift, bits=self.sign_bit + 1, pairs=pairs, words=words)


DEFAULT = Circuit()


@labelled
def positive(dealer: Dealer, x: UInt64[Array, "..."], circuit: Circuit = DEFAULT) -> Masked:
    """The bit x > 0 (1 or 0, additively shared) of a signed x, from one masked opening.

    1. take [r] and its bits; 2. open c = [x] + [r]; 3. `positive_from_opening`.

    Opened: c, the circuit's masked words, and the masked bit; all uniform. Rounds: 7 for the default
    (opening, 5 levels of the tree, conversion of the bit); otherwise 2 and the adder's levels. Correlated
    randomness for each value: one `Mask` with bits, by default 31 bit `AndTriple`s, one of `SharedBits`.
    Error: none, over the whole ring but -2^63, or over the circuit's range.
    """
    mask = dealer.take(circuit.mask(x.shape))
    return positive_from_opening(dealer, open_sum(x + mask["mask"]), mask, circuit)


def positive_from_opening(dealer: Dealer, c: UInt64[Array, "..."], mask: Dealt, circuit: Circuit) -> Masked:
    """The bit x > 0 from an opened c = x + r, where `mask` (of `circuit.mask`) shares r's bits.

    x > 0 means x - 1 >= 0 in units of the last place: the sign bit of (c - 1) - r is 0.
    """
    top, shared = circuit.sign_bit, mask["bits"]
    if circuit.layout == "words":
        public = c - 1
        generate, propagate = ~public & shared, shared ^ from_party_zero(~public)
        borrows = adders.carries_in_words(dealer, generate, propagate, circuit.adder, top)
        not_negative = shared ^ (borrows << 1) ^ from_party_zero(~public)
        word = bits.pack(not_negative >> top & 1)
    else:
        public = ring.bit_slice(c - 1)
        pairs = mask.get("pairs")
        borrowed = borrow(dealer, public[:top], shared[:top], circuit.adder, pairs)
        word = shared[top] ^ borrowed ^ from_party_zero(~public[top])
    return convert.to_ring_bit(dealer, word, c.shape)


def borrow(
    dealer: Dealer,
    public: UInt64[Array, "w b"],
    shared: UInt64[Array, "w b"],
    adder: Adder = "carry-tree",
    pairs: UInt64[Array, "h b"] | None = None,
) -> UInt64[Array, " b"]:
    """[public < shared] for unsigned numbers of w sliced bits, as words shared by exclusive or.

    A position generates a borrow (g) where public is 0 and shared is 1, and hands one on (p) where the two
    are equal. With `pairs`, the w // 2 products of shared neighbours, the first level needs no opening.
    Rounds: the adder's levels for w positions, or for ceil(w / 2) with pairs.
    """
    if pairs is None:
        g, p = ~public & shared, shared ^ from_party_zero(~public)
        return adders.carries(dealer, g, p, adder)[-1]
    even = len(public) // 2 * 2
    c_low, c_high = public[0:even:2], public[1:even:2]
    r_low, r_high = shared[0:even:2], shared[1:even:2]
    # p_high = r_high ^ ~c_high, g_low = ~c_low & r_low, p_low = r_low ^ ~c_low, multiplied out.
    p_high_r_low = pairs ^ (~c_high & r_low)
    g = (~c_high & r_high) ^ (~c_low & p_high_r_low)
    p = p_high_r_low ^ (~c_low & r_high) ^ from_party_zero(~c_low & ~c_high)
    # The last of an odd number of positions is alone.
    g = jnp.concatenate([g, ~public[even:] & shared[even:]])
    p = jnp.concatenate([p, shared[even:] ^ from_party_zero(~public[even:])])
    return adders.carries(dealer, g, p, adder)[-1]


@labelled
def resharing(dealer: Dealer, x: UInt64[Array, "..."], circuit: Circuit = DEFAULT) -> Masked:
    """The bit x > 0 of a signed x, from shares of the bits of each party's share.

    1. take P sharings of zero by exclusive or; party i adds the bits of its share x_i to the i-th (party 0 of
       x_0 - 1): now all hold shares of the bits of every x_i;
    2. binary adders over the parties, in a tree: [x_0 + x_1], [x_2 + x_3], ...; a + b has p = a ^ b and
       g = a & b (one opening), and its carries;
    3. the last adder finds the carry into the sign bit alone; 4. the bit is converted.

    Opened: masked words. Rounds: 1 + L for each of ceil(log2 P) adders, L the adder's levels, and 1: 8 at
    P = 2, 22 at P = 5. All but the last adder give every carry; "carry-tree" uses Kogge-Stone there.
    Correlated randomness: P `Zero`s, for each adder 64 bit `AndTriple`s and the network's, one of
    `SharedBits`. Error: none.
    Source: Knott et al., *CrypTen*, NeurIPS 2021, appendix C (there on words; here bits are sliced).
    """
    parties, me, width = lax.axis_size(AXIS), lax.axis_index(AXIS), circuit.sign_bit + 1
    own = ring.bit_slice(x - from_party_zero(jnp.ones_like(x)))[:width]
    zeros = dealer.take(Zero((parties, *own.shape), xor=True))["zero"]
    summands = jnp.where((np.arange(parties, dtype=np.int32) == me)[:, None, None], zeros ^ own, zeros)
    full = "kogge-stone" if circuit.adder == "carry-tree" else circuit.adder
    while len(summands) > 2:
        paired = len(summands) // 2 * 2
        # The adders of one level work side by side, as further columns.
        a, b = (jnp.concatenate(list(summands[i:paired:2]), axis=1) for i in (0, 1))
        total = _add(dealer, a, b, full)
        sums = jnp.stack(jnp.split(total, paired // 2, axis=1))
        summands = jnp.concatenate([sums, summands[paired:]])
    a, b = summands
    (generated,) = conjunction(dealer, a[:-1], b[None, :-1])
    carried = adders.carries(dealer, generated, a[:-1] ^ b[:-1], circuit.adder)[-1]
    not_negative = a[-1] ^ b[-1] ^ carried ^ from_party_zero(jnp.full_like(carried, 2**64 - 1))
    return convert.to_ring_bit(dealer, not_negative, x.shape)


def _add(
    dealer: Dealer, a: UInt64[Array, "w b"], b: UInt64[Array, "w b"], adder: Adder
) -> UInt64[Array, "w b"]:
    """The sum modulo 2^w of two numbers whose bits are sliced and shared by exclusive or."""
    p = a ^ b
    (g,) = conjunction(dealer, a[:-1], b[None, :-1])
    carried = adders.carries(dealer, g, p[:-1], adder)
    return p.at[1:].set(p[1:] ^ carried)


@dataclass(frozen=True)
class Sign:
    """A variant, as `Protocol(comparison=NAME)` chooses it.

    Attributes:
        run: `run(dealer, x, circuit)`, the bit x > 0 as `Masked`, or this party's share of it.
        layout: of the circuit that it is given.
        masked: whether it opens x under a mask, from whose opening a ReLU may truncate as well (`relu`).
    """

    run: Callable[[Dealer, UInt64[Array, "..."], Circuit], Masked | Array]
    layout: Literal["sliced", "words"] = "sliced"
    masked: bool = False


VARIANTS = {
    "masked": Sign(positive, masked=True),
    "masked-words": Sign(positive, layout="words", masked=True),
    "resharing": Sign(resharing),
    "ideal": Sign(lambda dealer, x, _: ideal_positive(dealer, x)),
}
