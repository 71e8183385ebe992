"""Products of shared values from a dealer's products (Beaver, *Efficient multiparty protocols using circuit
randomization*, CRYPTO 1991).

The factors come as `Masked` values, whose masks are already open: a value that enters several products
is opened once. The products themselves are then local. All are exact in the ring; fixed-point factors with f
and g fractional bits give a product with f + g, which `truncate` brings back.
"""

import jax.numpy as jnp
from jax import Array
from jaxtyping import UInt64

from ciphernav_jax import ring
from ciphernav_jax.parties.dealer import Dealer
from ciphernav_jax.parties.party import from_party_zero, labelled, open_xor
from ciphernav_jax.parties.requests import AndTriple, DotProduct, Product
from ciphernav_jax.protocols.masked import Masked
from ciphernav_jax.ring.linear import DimensionNumbers


@labelled
def multiply(dealer: Dealer, x: Masked, y: Masked) -> UInt64[Array, "..."]:
    """The elementwise product, with broadcasting: this party's share of x y.

    With x = e + sum_j k_j [m_j] and y = d + sum_l h_l [n_l]:

        [x y] = e d + d sum_j k_j [m_j] + e sum_l h_l [n_l] + sum_jl k_j h_l [m_j n_l].

    Opened: nothing. Rounds: 0 after those that opened x and y. Correlated randomness: one `Product` for each
    pair of terms. Error: none. For one plain mask on each side this is Beaver's multiplication.
    """
    total = from_party_zero(x.public * y.public)
    for term in x.terms:
        total += y.public * _scaled(term.share, term.factor)
    for term in y.terms:
        total += x.public * _scaled(term.share, term.factor)
    for left in x.terms:
        for right in y.terms:
            product = dealer.take(Product(left.ref, right.ref))["product"]
            total += _scaled(_scaled(product, left.factor), right.factor)
    return total


@labelled
def square(dealer: Dealer, x: Masked) -> UInt64[Array, "..."]:
    """The elementwise square [x^2] = e^2 + 2 e [a] + [a^2], for x under one mask; otherwise as `multiply`."""
    (term,) = x.terms
    squared = dealer.take(Product(term.ref, term.ref))["product"]
    return from_party_zero(x.public * x.public) + (x.public << 1) * term.share + squared


@labelled
def dot_general(
    dealer: Dealer, x: Masked, y: Masked, dimension_numbers: DimensionNumbers
) -> UInt64[Array, "..."]:
    """The tensor product of `lax.dot_general`: this party's share, for x = e + [a] and y = d + [b].

        [x y] = e ([b] + d) + [a] d + [a b],

    where d is added to party 0's share of b: two ring products for each party.
    Opened: nothing. Rounds: 0 after those that opened x and y. Correlated randomness: one `DotProduct`.
    Error: none.
    """
    (a,), (b,) = x.terms, y.terms
    product = dealer.take(DotProduct(a.ref, b.ref, dimension_numbers))["product"]
    product = ring.dot_general(x.public, b.share + from_party_zero(y.public), dimension_numbers, plus=product)
    return ring.dot_general(a.share, y.public, dimension_numbers, plus=product)


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
