"""Products: of two secrets by one opening of each factor, with public numbers locally."""

from typing import Any

import numpy as np
from jax import Array

from ciphernav_jax import ring
from ciphernav_jax.secret.rules.operands import Operand, scale
from ciphernav_jax.secret.rules.registry import Unsupported, composed, rule
from ciphernav_jax.secret.scaling import Public, dot_public, from_public, reciprocal
from ciphernav_jax.secret.value import Context, Value, where


class OneOfTwo(Value):
    """One of two public values, chosen by a secret bit: bit (on_true - on_false) + on_false. Local, exact.

    Its reciprocal is one of two as well, and so is a product with it, each of whose values keeps a precision
    of its own. (The derivative of max divides by such a value: 2 where the operands are equal, otherwise 1.)
    """

    def __init__(self, context: Context, bit: Value, on_false: Public, on_true: Public):
        self.bit, self.on_false, self.on_true = bit, on_false, on_true
        low, high = from_public(context, on_false), from_public(context, on_true)
        assert low.public is not None
        assert high.public is not None
        share = bit.share * (high.public - low.public) + low.share
        super().__init__(context, low.frac_bits, max(low.bound, high.bound), share=share)

    def reciprocal(self) -> "OneOfTwo":
        low, high = (reciprocal(self.context, x) for x in (self.on_false, self.on_true))
        return OneOfTwo(self.context, self.bit, low, high)

    def multiply(self, context: Context, x: Value) -> Value:
        """x times this value."""
        on_true, on_false = (scale(context, x, public) for public in (self.on_true, self.on_false))
        return where(self.bit, on_true, on_false)


@rule("mul")
def mul(context: Context, x: Operand, y: Operand, **_: Any) -> Value:
    for one, other in ((x, y), (y, x)):
        if isinstance(one, OneOfTwo) and isinstance(other, Value):
            return one.multiply(context, other)
    if isinstance(x, Value) and isinstance(y, Value):
        return x.times(y)
    secret, public = (x, y) if isinstance(x, Value) else (y, x)
    assert isinstance(secret, Value)
    assert not isinstance(public, Value)
    return scale(context, secret, public)


@rule("div")
def _div(context: Context, x: Operand, y: Operand) -> Value:
    if isinstance(y, OneOfTwo):
        return mul(context, x, y.reciprocal())
    if isinstance(y, Value):
        raise Unsupported("the divisor is secret; only public divisors are supported")
    return mul(context, x, reciprocal(context, y))


@composed("square")
def square(x: Array) -> Array:
    return x * x


@composed("integer_pow")
def power(x: Array, *, y: int) -> Array:
    if y < 1:
        raise Unsupported(f"the power {y} is not positive; divisions by a secret are not supported")
    if y == 1:
        return x
    squares = power(x * x, y=y // 2)
    return squares * x if y % 2 else squares


@rule("dot_general")
def _dot_general(
    context: Context, x: Operand, y: Operand, *, dimension_numbers: Any, preferred_element_type: Any, **_: Any
) -> Value:
    if preferred_element_type == np.bool_:  # the or of the ands: whether their number is positive
        return _dot_general(
            context, x, y, dimension_numbers=dimension_numbers, preferred_element_type=np.int64
        ).positive
    if isinstance(x, Value) and isinstance(y, Value):
        return x.bilinear(y, ring.DotProduct(dimension_numbers))
    if isinstance(x, Value):
        assert not isinstance(y, Value)
        return dot_public(context, x, y, dimension_numbers, public_left=False)
    assert isinstance(y, Value)
    return dot_public(context, y, x, dimension_numbers, public_left=True)
