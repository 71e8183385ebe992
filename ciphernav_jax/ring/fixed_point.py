"""Fixed point: a real number v stands in the ring as round(v * 2^f) modulo 2^64, in two's complement."""

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, lax
from jaxtyping import ArrayLike, Bool, Float, Integer, UInt64

from ciphernav_jax.jax_private import Tracer

WORD = 64

POISON = 2**63
"""The ring element that stands for no number: for a NaN, an infinity, or what is out of range."""


def require_x64() -> None:
    """Raises RuntimeError when JAX's 64-bit types are off: a ring element would lose its top half."""
    if not jax.config.read("jax_enable_x64"):
        raise RuntimeError(
            "ciphernav_jax computes in uint64, but JAX's 64-bit types are switched off. "
            'Call jax.config.update("jax_enable_x64", True), or remove the line that disabled them.'
        )


def value_range(frac_bits: int) -> float:
    """The bound 2^(63 - frac_bits): `encode` takes values v with -bound <= v < bound."""
    return 2.0 ** (WORD - 1 - frac_bits)


@jax.custom_jvp
def no_gradient(x: ArrayLike) -> Array:
    """The identity on values that are about to be encoded; differentiating it raises TypeError.

    Rounding has derivative zero almost everywhere, so without this guard a gradient taken through
    shares would come out as zeros in silence.
    """
    return jnp.asarray(x)


@no_gradient.defjvp
def _no_gradient_jvp(primals, tangents):
    raise TypeError(
        "cannot differentiate through shares: encoding rounds, and its derivative is zero. "
        "Write secure(jax.grad(f)) in place of jax.grad(secure(f)): "
        "the gradient is then itself evaluated on secrets."
    )


def encode(
    values: Float[ArrayLike, "..."] | Integer[ArrayLike, "..."] | Bool[ArrayLike, "..."], frac_bits: int
) -> UInt64[Array, "..."]:
    """Fixed-point encoding round(v * 2^frac_bits) mod 2^64, ties to even.

    Args:
        values: real numbers v of any shape, |v| within `value_range(frac_bits)`. The encoding is exact when
            v * 2^frac_bits is an integer; so integers always are, also those beyond a float's 53 bits.
        frac_bits: fractional bits f, 0 <= f <= 62; the resolution is 2^-f.

    Raises:
        ValueError: a value is not finite or out of range. Only concrete values can be looked at: under
            `jit` the check is the caller's; out of range, a float saturates and an integer wraps around.
        RuntimeError: 64-bit types are switched off.
        TypeError: the encoding is being differentiated.
    """
    require_x64()
    if not 0 <= frac_bits <= WORD - 2:
        raise ValueError(f"frac_bits must lie in 0..{WORD - 2}, got {frac_bits}")
    if not isinstance(values, Tracer):
        _check_range(np.asarray(values), frac_bits)
    values = no_gradient(values)
    if jnp.issubdtype(values.dtype, jnp.integer):
        return lax.bitcast_convert_type(values.astype(jnp.int64) << frac_bits, jnp.uint64)
    scaled = jnp.round(values.astype(jnp.float64) * 2.0**frac_bits)
    # Through int64: casting a negative float to uint64 is undefined (0 on CPU).
    return lax.bitcast_convert_type(scaled.astype(jnp.int64), jnp.uint64)


def _check_range(values: np.ndarray, frac_bits: int) -> None:
    bound = value_range(frac_bits)
    if np.issubdtype(values.dtype, np.integer):
        outside = (values < -int(bound)) | (values >= int(bound))  # as integers: a float would round
    else:
        values = values.astype(np.float64)
        if not np.all(np.isfinite(values)):
            raise ValueError("cannot encode values that are not finite (NaN or infinity)")
        outside = (values < -bound) | (values >= bound)
    if np.any(outside):
        worst = max(values[outside].tolist(), key=abs)
        raise ValueError(
            f"cannot encode {worst:g}: with {frac_bits} fractional bits values lie in "
            f"[-{bound:g}, {bound:g}). Scale the values down or use fewer fractional bits."
        )


def fits(values: Array | np.ndarray, bound: float) -> Bool[Array, "..."] | Bool[np.ndarray, "..."] | bool:
    """Which of the values lie below the bound in magnitude; True where their dtype has no others."""
    if values.dtype == np.bool_ or (
        jnp.issubdtype(values.dtype, jnp.integer) and np.iinfo(values.dtype).max < bound
    ):
        return True
    below = values < bound  # false for NaN
    return below if jnp.issubdtype(values.dtype, jnp.unsignedinteger) else below & (values > -bound)


def encode_or_poison(values: Array | np.ndarray, frac_bits: int, bound: float) -> UInt64[Array, "..."]:
    """As `encode`, but what does not lie below the bound in magnitude, and NaN, becomes `POISON`."""
    inside = fits(values, bound)
    if inside is True:
        return encode(values, frac_bits)
    return jnp.where(inside, encode(jnp.where(inside, values, 0), frac_bits), np.uint64(POISON))


def decode(
    elements: UInt64[Array, "..."], frac_bits: int, dtype: jnp.dtype | type = jnp.float64
) -> Float[Array, "..."]:
    """The real numbers that ring elements stand for: the signed value divided by 2^frac_bits.

    Exact in float64 for |v| <= 2^(53 - frac_bits); beyond, and in float32, rounded to nearest (beyond that
    and in float32, twice).
    """
    signed = lax.bitcast_convert_type(elements, jnp.int64)
    return (signed.astype(jnp.float64) * 2.0**-frac_bits).astype(dtype)
