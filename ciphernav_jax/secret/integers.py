"""Integers wrap around as JAX's do.

Sums and products modulo 2^64 are right modulo 2^8 and 2^32 as well. So a secret of a narrow type need not be
brought back into the range of its type at each step. That waits for whoever looks at how large it is: a
comparison, a maximum, a conversion, the end of the program. Of the signed types the value's bound tells
whether it may be out of range. Unsigned ones are brought back at once where they may have fallen below 0.

Integers of 64 bits have the ring's own arithmetic. They are compared as signed numbers, so an unsigned one
must not fall below 0 at all.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from ciphernav_jax.jax_private import JaxprEqn
from ciphernav_jax.protocols import truncate
from ciphernav_jax.secret.value import Value

LOOKING = {
    *("eq", "ne", "gt", "lt", "ge", "le", "sign", "abs"),
    *("max", "min", "clamp", "reduce_max", "reduce_min", "argmax", "argmin"),
}
"""The primitives that look at how large an integer is."""

LEAST_NEGATED = {"neg", "sub", "mul", "integer_pow", "square", "dot_general", "abs"}
"""Those by which the least integer of a signed type, -2^(n - 1), may become 2^(n - 1)."""


class BelowZero(Exception):
    """A secret uint64 may fall below 0."""


def wrapped(x: Value, dtype: np.dtype) -> Value:
    """The value in the range of an integer type; of other types, and of integers in range, as it is."""
    if not _narrow(dtype) or x.bound <= _most(dtype):
        return x
    return _wrapped(x, dtype)


def _wrapped(x: Value, dtype: np.dtype) -> Value:
    if dtype not in x.in_range:
        bits, signed = 8 * dtype.itemsize, dtype.kind == "i"
        share = truncate.wrapped(x.context.dealer, x.share, bits, signed=signed)
        x.in_range[dtype] = Value(x.context, 0, _most(dtype), share=share)
    return x.in_range[dtype]


def _narrow(dtype: np.dtype) -> bool:
    return np.issubdtype(dtype, np.integer) and dtype.itemsize < 8


def _most(dtype: np.dtype) -> int:
    """The largest magnitude in the type."""
    info = np.iinfo(dtype)
    return max(-int(info.min), int(info.max))


def _dtypes(variables: Sequence[Any]) -> list[np.dtype]:
    return [x.aval.dtype for x in variables]


def looked_at(eqn: JaxprEqn, operands: Sequence[Any]) -> list[Any]:
    """The operands of an equation on secrets, in range where it looks at how large they are."""
    dtypes = _dtypes(eqn.invars)
    if not any(_narrow(dtype) for dtype in dtypes):
        return list(operands)
    match eqn.primitive.name:
        case "select_n" if _narrow(dtypes[0]) and isinstance(operands[0], Value):
            # Of two cases, with an integer: the first unless it is 1 or more.
            return [wrapped(operands[0], dtypes[0]).positive, *operands[1:]]
        case "convert_element_type":
            looks = _more_than_the_last_bits(dtypes[0], _dtypes(eqn.outvars)[0])
        case "dot_general":
            looks = _dtypes(eqn.outvars)[0] != dtypes[0]
        case name:
            looks = name in LOOKING
    if not looks:
        return list(operands)
    return [
        wrapped(x, dtype) if isinstance(x, Value) else x for x, dtype in zip(operands, dtypes, strict=True)
    ]


def _more_than_the_last_bits(old: np.dtype, new: np.dtype) -> bool:
    """Whether a conversion needs more of an integer than its last bits."""
    return new.kind not in "iu" or new.itemsize > old.itemsize


def of_its_type(eqn: JaxprEqn, result: Any) -> Any:
    """The result of an equation on secrets, so that its bound tells whether it is in the range of its type.

    Raises:
        BelowZero: a secret uint64 may fall below 0.
    """
    name, dtype = eqn.primitive.name, _dtypes(eqn.outvars[:1])[0]
    if not isinstance(result, Value) or dtype.kind not in "iu":
        return result
    if dtype.kind == "u":
        signed = name == "convert_element_type" and _dtypes(eqn.invars)[0].kind == "i"
        if name not in ("neg", "sub") and not signed:
            return result
        if not _narrow(dtype):
            raise BelowZero
        return _wrapped(result, dtype)
    if _narrow(dtype) and name in LEAST_NEGATED and result.bound == _most(dtype):
        result = result.like(result.share)
        result.bound += 1
    return result
