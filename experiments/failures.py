"""How often a truncation fails."""

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, lax

from ciphernav_jax.protocols import Protocol
from ciphernav_jax.ring import keys
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
        x = jnp.where(
            jax.random.bernoulli(keys.derive(key, "signs"), shape=(count,)), float(value), -float(value)
        )
        factors = share(key, (x, jnp.ones_like(x)), parties=parties, protocol=protocol)
        error = reveal(multiply(key, *factors)) - x
        return None, jnp.sum(jnp.abs(error) > parties * 2.0**-protocol.frac_bits)

    key = keys.derive(keys.root(seed), "failures", str(protocol), parties, repr(value), count)
    of_rounds = keys.derive(key, "round", np.arange(rounds))
    failed = jax.jit(lambda of_rounds: lax.scan(one_round, None, of_rounds)[1])(of_rounds)
    return int(jnp.sum(failed)), rounds * count
