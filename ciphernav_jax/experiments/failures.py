"""How often a truncation fails."""

import jax
import jax.numpy as jnp
from jax import Array, lax

from ciphernav_jax.protocols import Protocol
from ciphernav_jax.secret import reveal, secure, share


def failures(
    protocol: Protocol,
    parties: int,
    value: float = 30_000,
    rounds: int = 40,
    count: int = 1 << 18,
    seed: int = 0,
) -> tuple[int, int]:
    """How many truncations of products +-value, from 2 f to the protocol's f fractional bits, fail.

    The products are of +-value and 1, both secret. A truncation has failed when it lands more than P units
    from the product, farther than any variant rounds.

    Args:
        protocol: the variant, by its name and fractional bits.
        parties: P.
        value: the products' magnitude, below `protocol.bound`.
        rounds, count: `rounds` times `count` truncations, each round with fresh shares and randomness.
        seed: of the signs, the shares and the dealer.

    Returns:
        The number of those that failed, and of all.

    Raises:
        ValueError: a value out of range; a variant that this number of parties does not have.
    """
    if not 0 <= value < protocol.bound:
        raise ValueError(f"products must lie within {protocol.bound:g} in magnitude, got {value:g}")
    multiply = secure(jnp.multiply, protocol=protocol)

    def one_round(_: None, key: Array) -> tuple[None, Array]:
        sign_key, share_key, dealer_key = jax.random.split(key, 3)
        x = jnp.where(jax.random.bernoulli(sign_key, shape=(count,)), float(value), -float(value))
        factors = share(share_key, (x, jnp.ones_like(x)), parties=parties, protocol=protocol)
        error = reveal(multiply(dealer_key, *factors)) - x
        return None, jnp.sum(jnp.abs(error) > parties * 2.0**-protocol.frac_bits)

    keys = jax.random.split(jax.random.key(seed), rounds)
    return int(jnp.sum(jax.jit(lambda keys: lax.scan(one_round, None, keys)[1])(keys))), rounds * count
