"""Masked values: a secret written as public numbers plus public multiples of the dealer's values.

    [x] = e + sum_j k_j [m_j],   e and k_j public, m_j from the dealer.

Every opening leaves such a form behind: a Beaver opening e + a, a truncation c' - R + k t, a bit
t + (1 - 2 t) s. A product of two such values needs only the dealer's products [m_j m_l]: no further opening.
"""

from dataclasses import dataclass

import jax.numpy as jnp
from jax import Array
from jaxtyping import UInt64

from ciphernav_jax.parties.dealer import Dealer
from ciphernav_jax.parties.party import from_party_zero, labelled, open_sum
from ciphernav_jax.parties.requests import Mask, Ref


@dataclass(frozen=True)
class Term:
    """A public multiple k [m] of a dealer's value: `factor` k (None for 1), this party's `share` of m."""

    factor: UInt64[Array, "..."] | None
    share: UInt64[Array, "..."]
    ref: Ref

    def negated(self) -> "Term":
        """-k [m]."""
        minus_one = jnp.full(self.share.shape, 2**64 - 1, jnp.uint64)
        return Term(minus_one if self.factor is None else -self.factor, self.share, self.ref)


@dataclass(frozen=True)
class Masked:
    """A secret as public + sum of terms; the shapes of public and terms are equal."""

    public: UInt64[Array, "..."]
    terms: tuple[Term, ...]

    def share(self) -> UInt64[Array, "..."]:
        """This party's additive share of the secret. Local."""
        total = from_party_zero(self.public)
        for term in self.terms:
            total += term.share if term.factor is None else term.factor * term.share
        return total


@labelled
def open_masked(dealer: Dealer, x: UInt64[Array, "..."]) -> Masked:
    """Opens x under a fresh uniform mask.

    1. take [a], a uniform;  2. open e = [x] - [a];  then x = e + [a].

    Opened: e, uniform and independent of x. Rounds: 1. Correlated randomness: one `Mask`.
    Source: Beaver, CRYPTO 1991.
    """
    mask = dealer.take(Mask(x.shape))
    return Masked(open_sum(x - mask["mask"]), (Term(None, mask["mask"], mask.ref("mask")),))
