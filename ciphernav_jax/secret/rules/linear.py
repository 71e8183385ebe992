"""Linear operations: local."""

import math
from typing import Any

import jax.numpy as jnp
from jax import lax

from ciphernav_jax.secret.rules.operands import Operand, to_value
from ciphernav_jax.secret.rules.registry import rule
from ciphernav_jax.secret.value import Context, Value


@rule("add", "add_any")
def add(context: Context, x: Operand, y: Operand, **_: Any) -> Value:
    return to_value(context, x).add(to_value(context, y))


@rule("sub")
def sub(context: Context, x: Operand, y: Operand, **_: Any) -> Value:
    return to_value(context, x).add(to_value(context, y).negated())


@rule("neg")
def _neg(context: Context, x: Value) -> Value:
    return x.negated()


@rule("reduce_sum")
def reduce_sum(context: Context, x: Value, *, axes: tuple[int, ...], **_: Any) -> Value:
    count = math.prod(x.shape[axis] for axis in axes)
    return x.summed(count, lambda share: jnp.sum(share, axis=axes, dtype=jnp.uint64), axes)


@rule("cumsum")
def _cumsum(context: Context, x: Value, *, axis: int, **params: Any) -> Value:
    return x.summed(x.shape[axis], lambda share: lax.cumsum_p.bind(share, axis=axis, **params))
