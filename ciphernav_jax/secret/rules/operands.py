"""Operands of a rule: secret or public, with the precision that an operation or a result needs."""

import jax.numpy as jnp
import numpy as np

from ciphernav_jax.secret.integers import wrapped
from ciphernav_jax.secret.scaling import Public, from_public, times_constant, times_public
from ciphernav_jax.secret.value import Context, Value

Operand = Value | Public


def to_value(context: Context, x: Operand) -> Value:
    """A public operand as a value that party 0 holds; a secret one as it is."""
    return x if isinstance(x, Value) else from_public(context, x)


def frac_bits_at_rest(context: Context, dtype: np.dtype) -> int:
    """The fractional bits of a `Secret` of that dtype."""
    return context.protocol.frac_bits if jnp.issubdtype(dtype, np.floating) else 0


def at_rest(context: Context, x: Operand, dtype: np.dtype) -> Value:
    """An operand as a `Secret` of that dtype has it: truncated, of that precision, in the range of an integer
    type, shared if it is public.
    """
    return wrapped(to_value(context, x), dtype).settled.lifted(frac_bits_at_rest(context, dtype))


def is_zero(x: Operand) -> bool:
    """Whether this is a constant 0."""
    return isinstance(x, np.ndarray) and not np.any(x)


def bit(x: Value) -> Value:
    """A value that is known to be 0, 1 or -1."""
    return Value(x.context, 0, 1, share=x.share)


def scale(context: Context, x: Value, public: Public) -> Value:
    """A secret times a public number."""
    if isinstance(public, np.ndarray):
        return times_constant(x, public)
    return times_public(context, x, public)
