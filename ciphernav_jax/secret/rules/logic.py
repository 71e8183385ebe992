"""Logic on secret bits."""

from typing import Any

import numpy as np

from ciphernav_jax.secret.rules.comparisons import logical_not
from ciphernav_jax.secret.rules.linear import add, reduce_sum, sub
from ciphernav_jax.secret.rules.operands import Operand, bit
from ciphernav_jax.secret.rules.products import mul
from ciphernav_jax.secret.rules.registry import rule
from ciphernav_jax.secret.value import Context, Value


@rule("and")
def _and(context: Context, x: Operand, y: Operand) -> Value:
    return mul(context, x, y)


@rule("or")
def _or(context: Context, x: Operand, y: Operand) -> Value:
    return bit(sub(context, add(context, x, y), mul(context, x, y)))


@rule("xor")
def _xor(context: Context, x: Operand, y: Operand) -> Value:
    return bit(sub(context, add(context, x, y), mul(context, mul(context, x, y), np.array(2))))


@rule("reduce_or")
def _any(context: Context, x: Value, *, axes: tuple[int, ...], **_: Any) -> Value:
    return reduce_sum(context, x, axes=axes).positive


@rule("reduce_and")
def _all(context: Context, x: Value, *, axes: tuple[int, ...], **_: Any) -> Value:
    return logical_not(context, _any(context, sub(context, np.array(1), x), axes=axes))
