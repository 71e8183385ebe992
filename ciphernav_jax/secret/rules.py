"""One rule for each primitive: what a JAX operation becomes when some of its operands are secret.

A rule is called as `rule(context, *operands, **params)` with the primitive's own parameters. Operands are
`Value` (secret) or arrays (public; a numpy array where the value is known while tracing), and at least one is
secret. It returns the result, or a list of them.

By family: data movement, linear, products, comparisons, selection, logic. What has no rule is refused by
`secure` with its name and place in the user's program.
"""

from collections.abc import Callable
from contextlib import nullcontext
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, lax

from ciphernav_jax import ring
from ciphernav_jax.jax_private import Primitive
from ciphernav_jax.protocols.dealer import Zero
from ciphernav_jax.secret.value import (
    Context,
    Value,
    align,
    dot_public,
    times_constant,
    times_public,
    where,
)

Operand = Value | Array | np.ndarray
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


def _to_value(context: Context, x: Operand, frac_bits: int) -> Value:
    """A public operand as a sharing that party 0 holds; a secret one as it is."""
    if isinstance(x, Value):
        return x
    zero = Value(context, frac_bits, share=jnp.zeros(jnp.shape(x), jnp.uint64))
    return zero.add_public(ring.encode(x, frac_bits))


def frac_bits_at_rest(context: Context, dtype: np.dtype) -> int:
    """The fractional bits of a `Secret` of that dtype."""
    return context.protocol.frac_bits if jnp.issubdtype(dtype, np.floating) else 0


def at_rest(context: Context, x: Operand, dtype: np.dtype) -> Value:
    """An operand as a `Secret` of that dtype has it: truncated, of that precision, shared if it is public."""
    frac_bits = frac_bits_at_rest(context, dtype)
    if not isinstance(x, Value):
        return _fresh(context, x, frac_bits)
    return x.settled.lifted(frac_bits) if frac_bits else x


def _fresh(context: Context, x: Operand, frac_bits: int) -> Value:
    """As `_to_value`, for a public operand that will stand alone as a secret.

    Local truncation needs shares that are random: there the dealer's shares of zero make them so.
    """
    return x if isinstance(x, Value) else _refreshed(context, ring.encode(x, frac_bits), frac_bits)


def _refreshed(context: Context, words: Array, frac_bits: int) -> Value:
    """Public ring elements that will stand alone as secrets."""
    value = Value(context, frac_bits, share=jnp.zeros(words.shape, jnp.uint64)).add_public(words)
    if context.protocol.truncation != "local":
        return value
    zero = context.dealer.take(Zero(value.shape))["zero"]
    return Value(context, frac_bits, share=value.share + zero)


def _is_zero(x: Operand) -> bool:
    return isinstance(x, np.ndarray) and not np.any(x)


def _together(
    context: Context, operands: tuple[Operand, ...], to_value: Any = _to_value
) -> tuple[Value, ...]:
    """All operands as values with equal fractional bits."""
    secrets = iter(align(*[x for x in operands if isinstance(x, Value)]))
    aligned = [next(secrets) if isinstance(x, Value) else x for x in operands]
    frac_bits = next(x.frac_bits for x in aligned if isinstance(x, Value))
    bits = max(frac_bits, context.protocol.frac_bits if _has_public_float(operands) else 0)
    return tuple(to_value(context, x, bits).lifted(bits) for x in aligned)


def _side_by_side(context: Context, operands: tuple[Operand, ...]) -> tuple[Value, ...]:
    """As `_together`, for entries that will stand beside one another unmixed."""
    return _together(context, operands, _fresh)


def _has_public_float(operands: tuple[Operand, ...]) -> bool:
    return any(not isinstance(x, Value) and jnp.issubdtype(x.dtype, np.floating) for x in operands)


# --- data movement: the same operation on the shares ------------------------------------------------


def _moves(primitive: Primitive, data_operands: int | None = None) -> None:
    """Registers a primitive that only moves entries: applied to the shares as it is.

    The first `data_operands` operands are data (all if None); the rest are indices, which must be public.
    """

    def move(context: Context, *operands: Operand, **params: Any) -> Any:
        count = len(operands) if data_operands is None else data_operands
        indices = operands[count:]
        if any(isinstance(x, Value) for x in indices):
            raise Unsupported("an index is secret; indices must be public")
        data = _side_by_side(context, operands[:count])
        moved = primitive.bind(*[x.share for x in data], *indices, **params)
        frac_bits = data[0].frac_bits
        if primitive.multiple_results:
            return [Value(context, frac_bits, share=share) for share in moved]
        return Value(context, frac_bits, share=moved)

    RULES[primitive.name] = move


for _primitive in (
    lax.broadcast_in_dim_p,
    lax.concatenate_p,
    lax.copy_p,
    lax.cumsum_p,
    lax.pad_p,
    lax.reshape_p,
    lax.rev_p,
    lax.slice_p,
    lax.split_p,
    lax.squeeze_p,
    lax.stack_p,
    lax.tile_p,
    lax.transpose_p,
    lax.unstack_p,
):
    _moves(_primitive)
_moves(lax.dynamic_slice_p, data_operands=1)
_moves(lax.dynamic_update_slice_p, data_operands=2)


TYPED = {"gather"}
"""The rules that are also given the `dtype` of their result."""


@rule("gather")
def _gather(
    context: Context, x: Operand, indices: Operand, *, fill_value: Any, dtype: np.dtype, **params: Any
) -> Value:
    if isinstance(indices, Value) or not isinstance(x, Value):
        raise Unsupported("the indices are secret; gather takes public indices")
    if params["mode"] != lax.GatherScatterMode.FILL_OR_DROP:
        return Value(
            context, x.frac_bits, share=lax.gather_p.bind(x.share, indices, fill_value=None, **params)
        )

    def read(filled_with: Any, x: Array) -> Array:
        return lax.gather_p.bind(x, indices, fill_value=filled_with, **params)

    shape, known = x.shape, isinstance(indices, np.ndarray)
    with jax.ensure_compile_time_eval() if known else nullcontext():
        inside, filling = read(False, jnp.ones(shape, np.bool_)), read(fill_value, jnp.zeros(shape, dtype))
        if known:
            inside, filling = np.asarray(inside), np.asarray(filling)
    if known and np.all(inside):
        return Value(context, x.frac_bits, share=read(0, x.share))
    x = x.settled.lifted(frac_bits_at_rest(context, dtype))
    bound = 2.0 ** (62 - x.frac_bits)
    if known and not np.all(ring.fits(filling, bound)):
        raise Unsupported(
            f"an index is out of range, where JAX reads {fill_value}, which no secret can be. "
            'Give another fill_value to x.at[i].get, or use mode="clip"'
        )
    filling = _refreshed(context, ring.encode_or_poison(filling, x.frac_bits, bound), x.frac_bits)
    return Value(context, x.frac_bits, share=read(0, x.share)).add(filling)


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
        into, new = _side_by_side(context, (x, updates))
        # Not the primitive's own parameters: those hold a sum of floats, and shares are words.
        share = scatter(
            into.share,
            indices,
            new.share,
            dimension_numbers,
            indices_are_sorted=indices_are_sorted,
            unique_indices=unique_indices,
            mode=mode,
        )
        return Value(context, into.frac_bits, share=share)

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
    a, b = _together(context, (x, y))
    return a.add(b)


@rule("sub")
def _sub(context: Context, x: Operand, y: Operand, **_: Any) -> Value:
    a, b = _together(context, (x, y))
    return a.add(b.negated())


@rule("stop_gradient")
def _identity(context: Context, x: Value) -> Value:
    return x


@rule("neg")
def _neg(context: Context, x: Value) -> Value:
    return x.negated()


@rule("reduce_sum")
def _reduce_sum(context: Context, x: Value, *, axes: tuple[int, ...], **_: Any) -> Value:
    return Value(context, x.frac_bits, share=jnp.sum(x.share, axis=axes, dtype=jnp.uint64))


@rule("convert_element_type")
def _convert(context: Context, x: Value, *, new_dtype: np.dtype, **_: Any) -> Operand:
    if new_dtype == np.bool_:
        return _ne(context, x, np.array(0))
    if x.frac_bits > 0 and not jnp.issubdtype(new_dtype, np.floating):
        raise Unsupported(f"a secret with a fractional part cannot be rounded to {np.dtype(new_dtype).name}")
    return x


# --- products ---------------------------------------------------------------------------------------


@rule("mul")
def _mul(context: Context, x: Operand, y: Operand, **_: Any) -> Value:
    if isinstance(x, Value) and isinstance(y, Value):
        return x.times(y)
    secret, public = (x, y) if isinstance(x, Value) else (y, x)
    assert isinstance(secret, Value)
    multiply = times_constant if isinstance(public, np.ndarray) else times_public
    return multiply(secret, public)  # pyright: ignore[reportArgumentType]


@rule("div")
def _div(context: Context, x: Operand, y: Operand) -> Value:
    if isinstance(y, OneOfTwo):
        return _mul(context, x, y.reciprocal())
    if isinstance(y, Value):
        raise Unsupported("the divisor is secret; only public divisors are supported")
    return _mul(context, x, np.asarray(1.0 / y.astype(np.float64)) if isinstance(y, np.ndarray) else 1.0 / y)


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


def _greater(context: Context, x: Operand, y: Operand) -> Value:
    if _is_zero(y) and isinstance(x, Value):
        return x.positive if np.shape(y) in ((), x.shape) else _sub(context, x, y).positive
    return _sub(context, x, y).positive


def _not(context: Context, x: Value) -> Value:
    return _sub(context, np.array(1), x)


@rule("eq")
def _equal(context: Context, x: Operand, y: Operand) -> Operand:
    different = _ne(context, x, y)
    return _not(context, different) if isinstance(different, Value) else ~different


@rule("ne")
def _ne(context: Context, x: Operand, y: Operand) -> Operand:
    if x is y:
        return np.zeros(x.shape, np.bool_)  # the usual test for NaN, which no secret is
    above, below = _sides(context, _sub(context, x, y))
    return above.add(below)


def _sides(context: Context, x: Value) -> tuple[Value, Value]:
    """The bits x > 0 and x < 0, in one comparison."""
    both = Value(context, x.frac_bits, share=jnp.stack([x.share, -x.share])).positive
    return Value(context, 0, share=both.share[0]), Value(context, 0, share=both.share[1])


@rule("sign")
def _sign(context: Context, x: Value) -> Value:
    above, below = _sides(context, x)
    return above.add(below.negated())


RULES["gt"] = _greater
RULES["lt"] = lambda context, x, y: _greater(context, y, x)
RULES["le"] = lambda context, x, y: _not(context, _greater(context, x, y))
RULES["ge"] = lambda context, x, y: _not(context, _greater(context, y, x))


# --- selection --------------------------------------------------------------------------------------


@rule("max")
def _max(context: Context, x: Operand, y: Operand) -> Value:
    for secret, public in ((x, y), (y, x)):
        if _is_zero(public) and isinstance(secret, Value) and np.shape(public) in ((), secret.shape):
            return secret.relu
    return _add(context, _sub(context, x, y).relu, y)


@rule("min")
def _min(context: Context, x: Operand, y: Operand) -> Value:
    return _sub(context, x, _sub(context, x, y).relu)


@rule("clamp")
def _clamp(context: Context, low: Operand, x: Operand, high: Operand) -> Value:
    if not isinstance(x, Value):
        raise Unsupported("a bound is secret and the value public; write jnp.minimum and jnp.maximum")
    return _min(context, _max(context, x, low), high)


def _reduce_with(of_two: Callable[[Context, Value, Value], Value]) -> Rule:
    """A reduction by a tournament: halves against each other, log2 n comparisons deep, n - 1 in all."""

    def reduce(context: Context, x: Value, *, axes: tuple[int, ...], **_: Any) -> Value:
        x = x.settled
        share = jnp.moveaxis(x.share, axes, range(len(axes)))
        left = share.reshape(-1, *share.shape[len(axes) :])
        while len(left) > 1:
            half = len(left) // 2
            a, b = (Value(context, x.frac_bits, share=part) for part in (left[:half], left[half : 2 * half]))
            left = jnp.concatenate([of_two(context, a, b).share, left[2 * half :]])
        return Value(context, x.frac_bits, share=left[0])

    return reduce


RULES["reduce_max"] = _reduce_with(_max)
RULES["reduce_min"] = _reduce_with(_min)


@rule("abs")
def _abs(context: Context, x: Value) -> Value:
    return _sub(context, x.relu.scaled(-1), x)


class OneOfTwo(Value):
    """One of two public values, chosen by a secret bit: bit (on_true - on_false) + on_false. Local, exact.

    Its reciprocal is one of two as well. (The derivative of max divides by such a value: 2 where the operands
    are equal, otherwise 1.)
    """

    def __init__(
        self, context: Context, bit: Value, on_false: Array | np.ndarray, on_true: Array | np.ndarray
    ):
        frac_bits = context.protocol.frac_bits if _has_public_float((on_false, on_true)) else 0
        self.bit, self.on_false, self.on_true = bit, on_false, on_true
        low, high = ring.encode(on_false, frac_bits), ring.encode(on_true, frac_bits)
        chosen = Value(context, frac_bits, share=bit.share * (high - low)).add_public(low)
        super().__init__(context, frac_bits, share=chosen.share)

    def reciprocal(self) -> "OneOfTwo":
        return OneOfTwo(self.context, self.bit, 1.0 / self.on_false, 1.0 / self.on_true)


@rule("select_n")
def _select(context: Context, which: Operand, *cases: Operand) -> Operand:
    if not isinstance(which, Value):
        if isinstance(which, np.ndarray) and which.size and np.all(which == which.flat[0]):
            return cases[int(which.flat[0])]
        aligned = _side_by_side(context, cases)
        chosen = lax.select_n_p.bind(which, *[case.share for case in aligned])
        return Value(context, aligned[0].frac_bits, share=chosen)
    if len(cases) != 2:
        raise Unsupported(f"a secret index selects among {len(cases)} cases; only two are supported")
    on_false, on_true = cases
    if isinstance(on_true, Value) and _is_zero(on_false):
        return which.times(on_true)
    if not isinstance(on_true, Value) and not isinstance(on_false, Value):
        return OneOfTwo(context, which, on_false, on_true)
    bits = context.protocol.frac_bits if _has_public_float(cases) else 0
    return where(which, _to_value(context, on_true, bits), _to_value(context, on_false, bits))


@rule("argmax")
def _argmax(context: Context, x: Value, *, axes: tuple[int, ...], **_: Any) -> Value:
    """The index of the largest entry, the first of equals, without opening anything but masked words."""
    (axis,) = axes
    entries = Value(context, x.frac_bits, share=jnp.moveaxis(x.share, axis, -1))
    n = entries.shape[-1]
    if n == 1:
        return Value(context, 0, share=jnp.zeros(entries.shape[:-1], jnp.uint64))
    return (_tournament if context.protocol.argmax == "tree" else _pairwise)(context, entries)


def _pairwise(context: Context, x: Value) -> Value:
    """Every pair is compared at once; who wins n - 1 times is the largest: two comparisons deep."""
    n = x.shape[-1]
    low, high = np.triu_indices(n, 1)
    later_wins = Value(context, x.frac_bits, share=x.share[..., high] - x.share[..., low]).positive
    lost = np.zeros((len(low), n), np.int64)
    lost[np.arange(len(low)), low] = 1
    lost[np.arange(len(low)), high] = -1
    # An entry loses to the later ones that are larger, and to the earlier ones unless it is itself larger.
    contract = (((later_wins.share.ndim - 1,), (0,)), ((), ()))
    losses = dot_public(later_wins, lost, contract, public_left=False)
    losses = losses.add_public(jnp.arange(n, dtype=jnp.uint64))
    beaten = losses.positive
    index = times_constant(_not(context, beaten), np.arange(n))
    return Value(context, index.frac_bits, share=jnp.sum(index.share, axis=-1, dtype=jnp.uint64))


def _tournament(context: Context, x: Value) -> Value:
    """Neighbours are compared, and the winners again: n - 1 comparisons, ceil(log2 n) deep."""

    def part(value: Value, index: slice) -> Value:
        return Value(context, value.frac_bits, share=value.share[..., index])

    numbers = jnp.broadcast_to(jnp.arange(x.shape[-1], dtype=jnp.uint64), x.shape)
    index = _to_value(context, numbers, 0)
    while (n := x.shape[-1]) > 1:
        even = n // 2 * 2
        lower, upper = slice(0, even, 2), slice(1, even, 2)
        difference = _sub(context, part(x, upper), part(x, lower))
        largest = _add(context, difference.relu, part(x, lower))
        where_largest = where(difference.positive, part(index, upper), part(index, lower))
        rest = slice(even, n)
        joined = (align(largest, part(x, rest)), (where_largest, part(index, rest)))
        x, index = (
            Value(context, a.frac_bits, share=jnp.concatenate([a.share, b.share], axis=-1)) for a, b in joined
        )
    return Value(context, 0, share=index.share[..., 0])


@rule("argmin")
def _argmin(context: Context, x: Value, **params: Any) -> Value:
    return RULES["argmax"](context, x.negated(), **params)


# --- logic on secret bits ---------------------------------------------------------------------------


@rule("not")
def _logical_not(context: Context, x: Value) -> Value:
    return _not(context, x)


@rule("and")
def _and(context: Context, x: Operand, y: Operand) -> Value:
    return _mul(context, x, y)


@rule("or")
def _or(context: Context, x: Operand, y: Operand) -> Value:
    return _sub(context, _add(context, x, y), _mul(context, x, y))


@rule("xor")
def _xor(context: Context, x: Operand, y: Operand) -> Value:
    return _sub(context, _add(context, x, y), _mul(context, _mul(context, x, y), np.array(2)))


@rule("reduce_or")
def _any(context: Context, x: Value, *, axes: tuple[int, ...], **_: Any) -> Value:
    return _reduce_sum(context, x, axes=axes).positive


@rule("reduce_and")
def _all(context: Context, x: Value, *, axes: tuple[int, ...], **_: Any) -> Value:
    return _not(context, _any(context, _sub(context, np.array(1), x), axes=axes))
