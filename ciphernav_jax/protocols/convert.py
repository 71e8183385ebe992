"""Conversions between additive shares of ring elements and shares of their bits by exclusive or."""

import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import UInt64

from ciphernav_jax import ring
from ciphernav_jax.parties.dealer import Dealer
from ciphernav_jax.parties.party import from_party_zero, labelled, open_sum, open_xor
from ciphernav_jax.parties.requests import Mask, SharedBits
from ciphernav_jax.protocols import adders
from ciphernav_jax.protocols.masked import Masked, Term
from ciphernav_jax.ring import bits


@labelled
def to_ring_bit(dealer: Dealer, word: UInt64[Array, " b"], shape: tuple[int, ...]) -> Masked:
    """A row of bits, 64 to a word, to values 0 or 1 in the ring.

    1. take [s], uniform bits shared both ways; 2. open t = [x] ^ [s]; 3. [x] = t + (1 - 2 t) [s].

    Opened: t, uniform. Rounds: 1. Correlated randomness: one row of `SharedBits`. Error: none.
    Source: Rotaru and Wood, *MArBled circuits*, INDOCRYPT 2019 (daBits).
    """
    shared = dealer.take(SharedBits(shape))
    t = bits.unpack(open_xor(word ^ shared["words"]), shape)
    return Masked(t, (Term(1 - (t << 1), shared["bits"], shared.ref("bits")),))


@labelled
def to_ring(dealer: Dealer, words: UInt64[Array, "64 b"], shape: tuple[int, ...]) -> UInt64[Array, "..."]:
    """All 64 bits of the values, sliced and shared by exclusive or, to additive shares of the values.

    As `to_ring_bit` for each row j, then sum_j 2^j [x_j]. Opened: 64 masked bits a value. Rounds: 1.
    Correlated randomness: 64 rows of `SharedBits`. Error: none.
    """
    shared = dealer.take(SharedBits(shape, rows=(64,)))
    t = bits.unpack(open_xor(words ^ shared["words"]), shape)
    value = from_party_zero(t) + (1 - (t << 1)) * shared["bits"]
    weights = (np.uint64(1) << np.arange(64, dtype=np.uint64)).reshape(64, *[1] * len(shape))
    return jnp.sum(value * weights, axis=0, dtype=jnp.uint64)


@labelled
def to_bits(dealer: Dealer, x: UInt64[Array, "..."]) -> UInt64[Array, "64 b"]:
    """Additive shares of the values to their 64 bits, sliced and shared by exclusive or.

    1. take [r] and its bits; 2. open c = [x] + [r]; 3. x = c - r by a Kogge-Stone subtractor of public and
    shared bits: bit j is c_j ^ r_j ^ borrow_j.

    Opened: c and the prefix network's masked words, all uniform. Rounds: 7. Correlated randomness for each
    value: one `Mask` with bits and 599 bit `AndTriple`s. Error: none.
    Source: Escudero et al., CRYPTO 2020 (edaBits); Kogge and Stone, IEEE ToC 1973.
    """
    mask = dealer.take(Mask(x.shape, bits=64))
    public, shared = ring.bit_slice(open_sum(x + mask["mask"])), mask["bits"]
    g = ~public & shared
    p = shared ^ from_party_zero(~public)
    borrows = adders.carries(dealer, g[:-1], p[:-1], "kogge-stone")
    borrow = jnp.concatenate([jnp.zeros_like(g[:1]), borrows])
    return shared ^ borrow ^ from_party_zero(public)
