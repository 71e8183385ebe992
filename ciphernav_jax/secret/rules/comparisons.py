"""Comparisons: x > y is (x - y) > 0, exact in units of the last place."""

from collections.abc import Callable
from typing import Any, TypeGuard

import jax.numpy as jnp
import numpy as np

from ciphernav_jax import ring
from ciphernav_jax.secret import bounds
from ciphernav_jax.secret.rules.linear import sub
from ciphernav_jax.secret.rules.operands import Operand, bit
from ciphernav_jax.secret.rules.registry import Rule, Unsupported, rule
from ciphernav_jax.secret.scaling import Public, from_public, is_float, without_nan
from ciphernav_jax.secret.value import Context, Value


@rule("convert_element_type")
def _convert(context: Context, x: Value, *, new_dtype: np.dtype, **_: Any) -> Operand:
    if new_dtype == np.bool_:
        return _different(context, x, np.array(0))
    if x.frac_bits > 0 and not jnp.issubdtype(new_dtype, np.floating):
        raise Unsupported(f"a secret with a fractional part cannot be rounded to {np.dtype(new_dtype).name}")
    if jnp.issubdtype(new_dtype, np.floating):
        return x.at_most(bounds.at_rest(context.protocol, np.dtype(new_dtype)), context.protocol.frac_bits)
    return x


def beyond(x: Operand, secret: Value) -> TypeGuard[np.ndarray]:
    """Whether this is a constant whose entries are all larger in magnitude than a secret may be, or NaN."""
    if not isinstance(x, np.ndarray) or not x.size:
        return False
    whole = not is_float(x) or _is_large_integer(secret)
    return not np.any(ring.fits(x, 2.0 ** (62 - (0 if whole else secret.context.protocol.frac_bits))))


def comparable(context: Context, x: Operand) -> Value:
    """An operand as a value, for comparisons: what no secret reaches may be any number that none reaches."""
    if isinstance(x, Value) or is_float(x):
        return x if isinstance(x, Value) else from_public(context, x, bounds.COMPARED)
    if ring.fits(x, 2**62) is not True:
        least = 0 if np.issubdtype(x.dtype, np.unsignedinteger) else -(2**62)
        x = (np if isinstance(x, np.ndarray) else jnp).clip(x, least, 2**62)
    return from_public(context, x)


def _comparison(compare: Callable[[Context, Operand, Operand], Operand], known: Any) -> Rule:
    """The rule of a comparison, which numpy calls `known`."""

    def rule(context: Context, x: Operand, y: Operand) -> Operand:
        for one, other in ((x, y), (y, x)):
            if isinstance(one, Value) and beyond(other, one):
                zero = np.zeros((), other.dtype)  # as good as any secret
                return np.broadcast_to(known(zero, y) if one is x else known(x, zero), one.shape)
        return compare(context, x, y)

    return rule


def _is_large_integer(x: Operand) -> TypeGuard[Value]:
    """Whether this is an integer converted to a float, and perhaps larger than a result may be."""
    return isinstance(x, Value) and x.coarse is not None and not x.frac_bits


def _whole(context: Context, x: Public, rounded: str) -> Public:
    """A public number beside integers: "floor" or "ceil" of it, within what a secret integer may be."""
    numpy: Any = np if isinstance(x, np.ndarray) else jnp
    whole = getattr(numpy, rounded)(without_nan(context, x))
    return numpy.asarray(numpy.clip(whole, -(2.0**62), 2.0**62), np.int64)


def _greater(context: Context, x: Operand, y: Operand) -> Operand:
    shape, (x, y) = np.broadcast_shapes(np.shape(x), np.shape(y)), _unchosen(x, y)
    if x is y:
        return np.zeros(shape, np.bool_)
    # Of an integer x, x > c where x > floor(c), and c > x where ceil(c) > x.
    if _is_large_integer(x) and not isinstance(y, Value):
        x, y = x.shorter, _whole(context, y, "floor")
    elif _is_large_integer(y) and not isinstance(x, Value):
        x, y = _whole(context, x, "ceil"), y.shorter
    x, y = comparable(context, x), comparable(context, y)
    return (x if adds_nothing(y, x) else x.compared(y)).positive


def adds_nothing(y: Value, x: Value) -> bool:
    """Whether y is a constant 0, which adds nothing to x."""
    return y.public is not None and y.bound == 0 and np.shape(y.public) in ((), x.shape)


@rule("not")
def logical_not(context: Context, x: Value) -> Value:
    return bit(sub(context, np.array(1), x))


def _not(context: Context, x: Operand) -> Operand:
    return logical_not(context, x) if isinstance(x, Value) else ~x


def _unchosen(x: Operand, y: Operand) -> tuple[Operand, Operand]:
    """Operands of which the first is larger where x > y is: where one of x and y is the maximum or minimum
    of the other and a third, which may have been rounded, these are the two that it is made of.

    With m = max(y, z), m > y where z > y, and y > m nowhere, as y > y.
    """
    for one, other in ((x, y), (y, x)):
        if isinstance(one, Value) and one.choice is not None:
            a, b, above = one.choice
            for same, rest in ((a, b), (b, a)):
                if _is_same(other, same):
                    instead = rest if above == (one is x) else other
                    return (instead, other) if one is x else (other, instead)
    return x, y


def _is_same(x: Operand, y: Operand) -> bool:
    if isinstance(x, np.ndarray) and isinstance(y, np.ndarray):
        return np.array_equal(x, y)
    return x is y


def _different(context: Context, x: Operand, y: Operand) -> Operand:
    known = x is y or any(a is not b for a, b in zip(_unchosen(x, y), (x, y), strict=True))
    whole = any(map(_is_large_integer, (x, y))) and not (isinstance(x, Value) and isinstance(y, Value))
    if known or whole:  # x is not x: the usual test for NaN, which no secret is
        return _either(_greater(context, x, y), _greater(context, y, x))
    return _either(*_sides(comparable(context, x).compared(comparable(context, y))))


def _either(x: Operand, y: Operand) -> Operand:
    """Whether one of two bits is 1 that are not both 1; one that is public is 0."""
    if isinstance(x, Value) and isinstance(y, Value):
        return bit(x.add(y))
    return x if isinstance(x, Value) else y


def _sides(x: Value) -> tuple[Value, Value]:
    """The bits x > 0 and x < 0, in one comparison."""
    both = x.beside(x.negated()).positive
    return both.like(both.share[0]), both.like(both.share[1])


@rule("sign")
def _sign(context: Context, x: Value) -> Value:
    above, below = _sides(x)
    return bit(above.add(below.negated()))


rule("ne")(_comparison(_different, np.not_equal))
rule("eq")(_comparison(lambda context, x, y: _not(context, _different(context, x, y)), np.equal))
rule("gt")(_comparison(_greater, np.greater))
rule("lt")(_comparison(lambda context, x, y: _greater(context, y, x), np.less))
rule("le")(_comparison(lambda context, x, y: _not(context, _greater(context, x, y)), np.less_equal))
rule("ge")(_comparison(lambda context, x, y: _not(context, _greater(context, y, x)), np.greater_equal))


@rule("is_finite")
def _is_finite(context: Context, x: Value) -> np.ndarray:
    return np.ones(x.shape, np.bool_)
