"""Products of shared values from a dealer's products (Beaver, *Efficient multiparty protocols using circuit
randomization*, CRYPTO 1991).

The factors come as `Masked` values, whose masks are already open: a value that enters several products
is opened once. The products themselves are then local. All are exact in the ring; fixed-point factors with f
and g fractional bits give a product with f + g, which `truncate` brings back.
"""

import itertools

import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import UInt64

from ciphernav_jax import ring
from ciphernav_jax.parties.dealer import Dealer
from ciphernav_jax.parties.party import from_party_zero, label, labelled, open_xor
from ciphernav_jax.parties.requests import AndTriple, Bilinear
from ciphernav_jax.protocols.masked import Masked
from ciphernav_jax.ring.forms import Form


def bilinear(dealer: Dealer, x: Masked, y: Masked, form: Form) -> UInt64[Array, "..."]:
    """A product x y of any form that distributes over sums: this party's share of it.

    With x = e + sum_j k_j [m_j] and y = d + sum_l h_l [n_l]:

        [x y] = e [y] + sum_j k_j [m_j] d + sum_jl k_j h_l [m_j n_l],

    where party 0's share of y has d in it: for one plain mask on each side two ring products for each party,
    and this is Beaver's multiplication. Factors k_j and h_l other than 1 are of elementwise products alone.

    Opened: nothing. Rounds: 0 after those that opened x and y. Correlated randomness: one `Bilinear` for each
    pair of terms. Error: none. Its costs are counted under the name of the form.
    """
    with jax.named_scope(label(form.name)):
        product = None
        for left, right in itertools.product(x.terms, y.terms):
            dealt = dealer.take(Bilinear(left.ref, right.ref, form))["product"]
            dealt = _scaled(_scaled(dealt, left.factor), right.factor)
            product = dealt if product is None else product + dealt
        product = form(x.public, y.share(), plus=product)
        for left in x.terms:
            product = form(_scaled(left.share, left.factor), y.public, plus=product)
        return product


@labelled
def square(dealer: Dealer, x: Masked) -> UInt64[Array, "..."]:
    """The elementwise square [x^2] = e^2 + 2 e [a] + [a^2], for x under one mask; otherwise as `bilinear`."""
    (term,) = x.terms
    squared = dealer.take(Bilinear(term.ref, term.ref, ring.TIMES))["product"]
    return from_party_zero(x.public * x.public) + (x.public << 1) * term.share + squared


@labelled
def conjunction(
    dealer: Dealer, x: UInt64[Array, "..."], ys: UInt64[Array, "k ..."]
) -> UInt64[Array, "k ..."]:
    """Bitwise x & y for words shared by exclusive or, one x with k words y: this party's shares.

    1. take [a], [b], [a & b];  2. open e = [x] ^ [a] and d = [y] ^ [b];
    3. [x & y] = (e & d) ^ (e & [b]) ^ ([a] & d) ^ [a & b].

    Opened: e and d, uniform. Rounds: 1. Correlated randomness: one `AndTriple`. Error: none.
    """
    triple = dealer.take(AndTriple(x.shape, ys.shape[0]))
    left, right = triple["left"], triple["right"]
    opened = open_xor(jnp.concatenate([(x ^ left)[None], ys ^ right]))
    e, d = opened[0], opened[1:]
    return (e & (right ^ from_party_zero(d))) ^ (left & d) ^ triple["product"]


def _scaled(x: UInt64[Array, "..."], factor: UInt64[Array, "..."] | None) -> UInt64[Array, "..."]:
    return x if factor is None else x * factor
