"""One rule for each primitive: what a JAX operation becomes when some of its operands are secret.

A rule is called as `rule(context, *operands, **params)` with the primitive's own parameters. Operands are
`Value` (secret) or arrays (public; a numpy array where the value is known while tracing), and at least one is
secret. It returns the result, or a list of them.

By family: data movement, linear, products, comparisons, selection, logic. What has no rule is refused by
`secure` with its name and place in the user's program.
"""

import itertools
import math
from collections.abc import Callable
from contextlib import nullcontext
from functools import partial
from typing import Any, TypeGuard

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, lax

from ciphernav_jax import ring
from ciphernav_jax.jax_private import Primitive
from ciphernav_jax.secret import bounds
from ciphernav_jax.secret.integers import wrapped
from ciphernav_jax.secret.scaling import (
    Public,
    dot_public,
    from_public,
    is_float,
    reciprocal,
    times_constant,
    times_public,
    without_nan,
)
from ciphernav_jax.secret.value import Context, Move, Value, join, where

Operand = Value | Public
Rule = Callable[..., Any]
RULES: dict[str, Rule] = {}


class Unsupported(Exception):
    """A rule cannot take these operands; the message says why, and the way out."""


def rule(*names: str) -> Callable[[Rule], Rule]:
    """Registers a rule under the names of primitives."""

    def register(function: Rule) -> Rule:
        RULES.update(dict.fromkeys(names, function))
        return function

    return register


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


def _is_zero(x: Operand) -> bool:
    return isinstance(x, np.ndarray) and not np.any(x)


# --- data movement: the same operation on the shares ------------------------------------------------


MOVES = {"gather", "scatter", "select_n", "split", "stop_gradient", "unstack"}
"""The rules that compute nothing: an entry that stands for no number stays recognisable as such."""


def _moves(
    primitive: Primitive, data_operands: int | None = None, back: Callable[..., Move] | None = None
) -> None:
    """Registers a primitive that only moves entries: applied to the shares as it is.

    The first `data_operands` operands are data (all if None); the rest are indices, which must be public.
    `back(shape, **params)` undoes it, where it keeps the number of entries, for results of operands of that
    shape.
    """

    def move(context: Context, *operands: Operand, **params: Any) -> Any:
        count = len(operands) if data_operands is None else data_operands
        indices = operands[count:]
        if any(isinstance(x, Value) for x in indices):
            raise Unsupported("an index is secret; indices must be public")
        data = [to_value(context, x) for x in operands[:count]]

        def bound(*shares: Array) -> Any:
            return primitive.bind(*shares, *indices, **params)

        if count > 1:
            return join(bound, *data)
        moved = data[0].moved(bound)
        if back is not None and math.prod(moved.shape) == math.prod(data[0].shape):
            return data[0].moved(bound, back(data[0].shape, **params))
        return moved

    RULES[primitive.name] = move
    MOVES.add(primitive.name)


def _reshaped(shape: tuple[int, ...], /, **_: Any) -> Move:
    return partial(jnp.reshape, shape=shape)


for _primitive in (lax.concatenate_p, lax.pad_p, lax.slice_p, lax.stack_p, lax.tile_p):
    _moves(_primitive)
for _primitive in (lax.broadcast_in_dim_p, lax.copy_p, lax.reshape_p, lax.squeeze_p):
    _moves(_primitive, back=_reshaped)
_moves(lax.rev_p, back=lambda _, /, dimensions: partial(lax.rev, dimensions=dimensions))
_moves(
    lax.transpose_p,
    back=lambda _, /, permutation: partial(jnp.transpose, axes=tuple(map(int, np.argsort(permutation)))),
)
_moves(lax.dynamic_slice_p, data_operands=1)
_moves(lax.dynamic_update_slice_p, data_operands=2)


@rule("split")
def _split(context: Context, x: Value, *, sizes: tuple[int, ...], axis: int) -> list[Value]:
    ends = list(itertools.accumulate(sizes))
    return [
        x.moved(partial(lax.slice_in_dim, start_index=end - size, limit_index=end, axis=axis))
        for size, end in zip(sizes, ends, strict=True)
    ]


@rule("unstack")
def _unstack(context: Context, x: Value, *, axis: int) -> list[Value]:
    return [
        x.moved(partial(lax.index_in_dim, index=i, axis=axis, keepdims=False)) for i in range(x.shape[axis])
    ]


TYPED = {"gather", "reduce_max", "reduce_min"}
"""The rules that are also given the `dtype` of their result."""


@rule("gather")
def _gather(
    context: Context, x: Operand, indices: Operand, *, fill_value: Any, dtype: np.dtype, **params: Any
) -> Value:
    if isinstance(indices, Value) or not isinstance(x, Value):
        raise Unsupported("the indices are secret; gather takes public indices")
    if params["mode"] != lax.GatherScatterMode.FILL_OR_DROP:
        return x.moved(lambda share: lax.gather_p.bind(share, indices, fill_value=None, **params))

    def read(filled_with: Any, x: Array) -> Array:
        return lax.gather_p.bind(x, indices, fill_value=filled_with, **params)

    shape, known = x.shape, isinstance(indices, np.ndarray)
    with jax.ensure_compile_time_eval() if known else nullcontext():
        inside, filling = read(False, jnp.ones(shape, np.bool_)), read(fill_value, jnp.zeros(shape, dtype))
        if known:
            inside, filling = np.asarray(inside), np.asarray(filling)
    entries = x.moved(partial(read, 0))
    if known and np.all(inside):
        return entries
    if fill_value is not None and is_float(filling) and np.isinf(fill_value):
        return entries.add(from_public(context, filling))  # a mask, as elsewhere
    frac_bits = frac_bits_at_rest(context, dtype)
    bound = 2.0 ** (62 - frac_bits)
    if known and not np.all(ring.fits(filling, bound)):
        raise Unsupported(_no_secret(fill_value))
    public = ring.encode_or_poison(filling, frac_bits, bound)
    filled = entries.add(
        Value(context, frac_bits, bounds.resting(context.protocol, frac_bits), public=public)
    )
    if is_float(filling) and (
        fill_value is None or not np.all(ring.fits(np.asarray(fill_value, np.float64), bound))
    ):
        filled.poisoned = ~jnp.all(jnp.asarray(ring.fits(filling, bound)))
    return filled


def _no_secret(fill_value: Any) -> str:
    return (
        f"an index is out of range, where JAX reads {fill_value}, which no secret can be. Give another "
        'fill_value to x.at[i].get, or use mode="clip"'
    )


def _scatter_into(scatter: Callable[..., Array]) -> Rule:
    """The rule of a scatter of any of operand and updates that are secret, at public indices."""

    def scattered(
        context: Context,
        x: Operand,
        indices: Operand,
        updates: Operand,
        *,
        dimension_numbers: lax.ScatterDimensionNumbers,
        indices_are_sorted: bool,
        unique_indices: bool,
        mode: lax.GatherScatterMode,
        update_jaxpr: Any = None,
        **_: Any,
    ) -> Value:
        if isinstance(indices, Value):
            raise Unsupported("the indices are secret; scatter takes public indices")
        if scatter is lax.scatter and not _is_set(update_jaxpr):
            raise Unsupported("x.at[i].apply(f) has no rule. Write x.at[i].set(f(x[i]))")

        # Not the primitive's own parameters: those hold a sum of floats, and shares are words.
        def bound(into: Array, new: Array) -> Array:
            return scatter(
                into,
                indices,
                new,
                dimension_numbers,
                indices_are_sorted=indices_are_sorted,
                unique_indices=unique_indices,
                mode=mode,
            )

        into, new = to_value(context, x), to_value(context, updates)
        if scatter is lax.scatter:
            return join(bound, into, new)
        zeros = jnp.zeros(into.shape, jnp.uint64)
        return into.add(new.summed(math.prod(indices.shape[:-1]), lambda share: bound(zeros, share)))

    return scattered


def _is_set(update_jaxpr: Any) -> bool:
    """Whether a scatter sets entries to the updates; `x.at[i].apply(f)` computes them from the entries."""
    return update_jaxpr is None or (
        not update_jaxpr.eqns and update_jaxpr.outvars[0] is update_jaxpr.invars[1]
    )


RULES["scatter"] = _scatter_into(lax.scatter)


# --- linear -----------------------------------------------------------------------------------------

RULES["scatter-add"] = _scatter_into(lax.scatter_add)


@rule("add", "add_any")
def _add(context: Context, x: Operand, y: Operand, **_: Any) -> Value:
    return to_value(context, x).add(to_value(context, y))


@rule("sub")
def _sub(context: Context, x: Operand, y: Operand, **_: Any) -> Value:
    return to_value(context, x).add(to_value(context, y).negated())


@rule("stop_gradient")
def _identity(context: Context, x: Value) -> Value:
    return x


@rule("neg")
def _neg(context: Context, x: Value) -> Value:
    return x.negated()


@rule("reduce_sum")
def _reduce_sum(context: Context, x: Value, *, axes: tuple[int, ...], **_: Any) -> Value:
    count = math.prod(x.shape[axis] for axis in axes)
    return x.summed(count, lambda share: jnp.sum(share, axis=axes, dtype=jnp.uint64), axes)


@rule("cumsum")
def _cumsum(context: Context, x: Value, *, axis: int, **params: Any) -> Value:
    return x.summed(x.shape[axis], lambda share: lax.cumsum_p.bind(share, axis=axis, **params))


@rule("convert_element_type")
def _convert(context: Context, x: Value, *, new_dtype: np.dtype, **_: Any) -> Operand:
    if new_dtype == np.bool_:
        return _different(context, x, np.array(0))
    if x.frac_bits > 0 and not jnp.issubdtype(new_dtype, np.floating):
        raise Unsupported(f"a secret with a fractional part cannot be rounded to {np.dtype(new_dtype).name}")
    if jnp.issubdtype(new_dtype, np.floating):
        return x.at_most(bounds.at_rest(context.protocol, np.dtype(new_dtype)), context.protocol.frac_bits)
    return x


# --- products ---------------------------------------------------------------------------------------


@rule("mul")
def _mul(context: Context, x: Operand, y: Operand, **_: Any) -> Value:
    for one, other in ((x, y), (y, x)):
        if isinstance(one, OneOfTwo) and isinstance(other, Value):
            return one.multiply(other)
    if isinstance(x, Value) and isinstance(y, Value):
        return x.times(y)
    secret, public = (x, y) if isinstance(x, Value) else (y, x)
    assert isinstance(secret, Value)
    assert not isinstance(public, Value)
    return _scale(secret, public)


def _scale(x: Value, public: Public) -> Value:
    return times_constant(x, public) if isinstance(public, np.ndarray) else times_public(x, public)


@rule("div")
def _div(context: Context, x: Operand, y: Operand) -> Value:
    if isinstance(y, OneOfTwo):
        return _mul(context, x, y.reciprocal())
    if isinstance(y, Value):
        raise Unsupported("the divisor is secret; only public divisors are supported")
    return _mul(context, x, reciprocal(context, y))


@rule("square")
def _square(context: Context, x: Value) -> Value:
    return x.times(x)


@rule("integer_pow")
def _integer_pow(context: Context, x: Value, *, y: int) -> Value:
    if y < 1:
        raise Unsupported(f"the power {y} is not positive; divisions by a secret are not supported")
    if y == 1:
        return x
    square = _integer_pow(context, x.times(x), y=y // 2)
    return square.times(x) if y % 2 else square


@rule("dot_general")
def _dot_general(
    context: Context, x: Operand, y: Operand, *, dimension_numbers: Any, preferred_element_type: Any, **_: Any
) -> Value:
    if preferred_element_type == np.bool_:  # the or of the ands: whether their number is positive
        return _dot_general(
            context, x, y, dimension_numbers=dimension_numbers, preferred_element_type=np.int64
        ).positive
    if isinstance(x, Value) and isinstance(y, Value):
        return x.dot_general(y, dimension_numbers)
    if isinstance(x, Value):
        assert not isinstance(y, Value)
        return dot_public(x, y, dimension_numbers, public_left=False)
    assert isinstance(y, Value)
    return dot_public(y, x, dimension_numbers, public_left=True)


# --- comparisons: x > y is (x - y) > 0, exact in units of the last place ----------------------------


def _beyond(x: Operand, secret: Value) -> TypeGuard[np.ndarray]:
    """Whether this is a constant whose entries are all larger in magnitude than a secret may be, or NaN."""
    if not isinstance(x, np.ndarray) or not x.size:
        return False
    whole = not is_float(x) or _is_large_integer(secret)
    return not np.any(ring.fits(x, 2.0 ** (62 - (0 if whole else secret.context.protocol.frac_bits))))


def _comparable(context: Context, x: Operand) -> Value:
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
            if isinstance(one, Value) and _beyond(other, one):
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
    x, y = _comparable(context, x), _comparable(context, y)
    return (x if _is_nothing(y, x) else x.compared(y)).positive


def _is_nothing(y: Value, x: Value) -> bool:
    """Whether y is a constant 0, which adds nothing to x."""
    return y.public is not None and y.bound == 0 and np.shape(y.public) in ((), x.shape)


def _bit(x: Value) -> Value:
    """A value that is known to be 0, 1 or -1."""
    return Value(x.context, 0, 1, share=x.share)


@rule("not")
def logical_not(context: Context, x: Value) -> Value:
    return _bit(_sub(context, np.array(1), x))


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
    return _either(*_sides(_comparable(context, x).compared(_comparable(context, y))))


def _either(x: Operand, y: Operand) -> Operand:
    """Whether one of two bits is 1 that are not both 1; one that is public is 0."""
    if isinstance(x, Value) and isinstance(y, Value):
        return _bit(x.add(y))
    return x if isinstance(x, Value) else y


def _sides(x: Value) -> tuple[Value, Value]:
    """The bits x > 0 and x < 0, in one comparison."""
    both = x.beside(x.negated()).positive
    return both.like(both.share[0]), both.like(both.share[1])


@rule("sign")
def _sign(context: Context, x: Value) -> Value:
    above, below = _sides(x)
    return _bit(above.add(below.negated()))


RULES["ne"] = _comparison(_different, np.not_equal)
RULES["eq"] = _comparison(lambda context, x, y: _not(context, _different(context, x, y)), np.equal)
RULES["gt"] = _comparison(_greater, np.greater)
RULES["lt"] = _comparison(lambda context, x, y: _greater(context, y, x), np.less)
RULES["le"] = _comparison(lambda context, x, y: _not(context, _greater(context, x, y)), np.less_equal)
RULES["ge"] = _comparison(lambda context, x, y: _not(context, _greater(context, y, x)), np.greater_equal)


@rule("is_finite")
def _is_finite(context: Context, x: Value) -> np.ndarray:
    return np.ones(x.shape, np.bool_)


# --- selection --------------------------------------------------------------------------------------


def _never_chosen(context: Context, x: Operand, y: Operand, above: bool) -> Operand | None:
    """The other operand where one is a constant above all secrets, or with `above` false below them."""
    for secret, public in ((x, y), (y, x)):
        if isinstance(secret, Value) and _beyond(public, secret):
            shape = np.broadcast_shapes(secret.shape, np.shape(public))
            if np.all(public > 0 if above else public < 0):
                return secret.moved(partial(jnp.broadcast_to, shape=shape))
            if np.all(public < 0 if above else public > 0):
                return np.broadcast_to(public, shape)
    return None


@rule("max")
def _max(context: Context, x: Operand, y: Operand) -> Operand:
    """relu(x - y) + y, with a y that is public or waits for no truncation: the same in both places."""
    chosen = _never_chosen(context, x, y, above=False)
    if chosen is not None:
        return chosen
    larger = _larger(_comparable(context, x), _comparable(context, y))
    larger.choice = x, y, True
    return larger


def _larger(above: Value, base: Value) -> Value:
    if above.waits and base.waits:
        above, base = above.settled, base.settled
    if above.public is not None or base.waits:
        above, base = base, above
    if _is_nothing(base, above):
        return above.relu
    larger = above.compared(base).relu.add(base)
    bound = max(v.bound_at(larger.frac_bits) for v in (above, base))
    return Value(larger.context, larger.frac_bits, bound, share=larger.share)


@rule("min")
def _min(context: Context, x: Operand, y: Operand) -> Operand:
    chosen = _never_chosen(context, x, y, above=True)
    if chosen is not None:
        return chosen
    smaller = _larger(_comparable(context, x).negated(), _comparable(context, y).negated()).negated()
    smaller.choice = x, y, False
    return smaller


@rule("clamp")
def _clamp(context: Context, low: Operand, x: Operand, high: Operand) -> Operand:
    if not isinstance(x, Value):
        raise Unsupported("a bound is secret and the value public; write jnp.minimum and jnp.maximum")
    return _min(context, _max(context, x, low), high)


@rule("abs")
def _abs(context: Context, x: Value) -> Value:
    x = x.settled
    return Value(context, x.frac_bits, x.bound, share=(x.relu.share << 1) - x.share)


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

    def multiply(self, x: Value) -> Value:
        """x times this value."""
        return where(self.bit, _scale(x, self.on_true), _scale(x, self.on_false))


@rule("select_n")
def _select(context: Context, which: Operand, *cases: Operand) -> Operand:
    if not isinstance(which, Value):
        if isinstance(which, np.ndarray) and which.size and np.all(which == which.flat[0]):
            return cases[int(which.flat[0])]
        return join(partial(lax.select_n_p.bind, which), *[to_value(context, case) for case in cases])
    if len(cases) != 2:
        raise Unsupported(f"a secret index selects among {len(cases)} cases; only two are supported")
    on_false, on_true = cases
    if isinstance(on_true, Value) and _is_zero(on_false):
        return which.times(on_true)
    if not isinstance(on_true, Value) and not isinstance(on_false, Value):
        return OneOfTwo(context, which, on_false, on_true)
    return where(which, to_value(context, on_true), to_value(context, on_false))


# --- logic on secret bits ---------------------------------------------------------------------------


@rule("and")
def _and(context: Context, x: Operand, y: Operand) -> Value:
    return _mul(context, x, y)


@rule("or")
def _or(context: Context, x: Operand, y: Operand) -> Value:
    return _bit(_sub(context, _add(context, x, y), _mul(context, x, y)))


@rule("xor")
def _xor(context: Context, x: Operand, y: Operand) -> Value:
    return _bit(_sub(context, _add(context, x, y), _mul(context, _mul(context, x, y), np.array(2))))


@rule("reduce_or")
def _any(context: Context, x: Value, *, axes: tuple[int, ...], **_: Any) -> Value:
    return _reduce_sum(context, x, axes=axes).positive


@rule("reduce_and")
def _all(context: Context, x: Value, *, axes: tuple[int, ...], **_: Any) -> Value:
    return logical_not(context, _any(context, _sub(context, np.array(1), x), axes=axes))
