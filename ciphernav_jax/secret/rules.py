"""One rule for each primitive: what a JAX operation becomes when some of its operands are secret.

A rule is called as `rule(context, *operands, **params)` with the primitive's own parameters. Operands are
`Value` (secret) or arrays (public; a numpy array where the value is known while tracing), and at least one is
secret. It returns the result, or a list of them.

By family: data movement, linear, products, comparisons, selection, logic. What has no rule is refused by
`secure` with its name and place in the user's program.
"""

from collections.abc import Callable
from typing import Any

import jax.numpy as jnp
import numpy as np
from jax import Array, lax
from jax.extend.core import Primitive

from ciphernav_jax import ring
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


def _is_zero(x: Operand) -> bool:
    return isinstance(x, np.ndarray) and not np.any(x)


def _together(context: Context, operands: tuple[Operand, ...]) -> tuple[Value, ...]:
    """All operands as values with equal fractional bits."""
    secrets = iter(align(*[x for x in operands if isinstance(x, Value)]))
    aligned = [next(secrets) if isinstance(x, Value) else x for x in operands]
    frac_bits = next(x.frac_bits for x in aligned if isinstance(x, Value))
    bits = max(frac_bits, context.protocol.frac_bits if _has_public_float(operands) else 0)
    return tuple(_to_value(context, x, bits).lifted(bits) for x in aligned)


def _side_by_side(context: Context, operands: tuple[Operand, ...]) -> tuple[Value, ...]:
    """As `_together`, for entries that will stand beside one another unmixed.

    Public entries then have shares that are not random (party 0 holds them), which local truncation must
    never meet: so no truncation is left pending.
    """
    if any(not isinstance(x, Value) for x in operands):
        operands = tuple(x.settled if isinstance(x, Value) else x for x in operands)
    return _together(context, operands)


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
    lax.pad_p,
    lax.reshape_p,
    lax.rev_p,
    lax.slice_p,
    lax.split_p,
    lax.squeeze_p,
    lax.transpose_p,
):
    _moves(_primitive)
_moves(lax.dynamic_slice_p, data_operands=1)
_moves(lax.dynamic_update_slice_p, data_operands=2)


@rule("gather")
def _gather(context: Context, x: Operand, indices: Operand, **params: Any) -> Value:
    if isinstance(indices, Value) or not isinstance(x, Value):
        raise Unsupported("the indices are secret; gather takes public indices")
    if params.get("fill_value") is None:
        params["fill_value"] = 0  # out of range reads 0: a ring element has no NaN
    return Value(context, x.frac_bits, share=lax.gather_p.bind(x.share, indices, **params))


# --- linear -----------------------------------------------------------------------------------------


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
def _convert(context: Context, x: Value, *, new_dtype: np.dtype, **_: Any) -> Value:
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
def _dot_general(context: Context, x: Operand, y: Operand, *, dimension_numbers: Any, **_: Any) -> Value:
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
def _equal(context: Context, x: Operand, y: Operand) -> Value:
    return _not(context, _ne(context, x, y))


@rule("ne")
def _ne(context: Context, x: Operand, y: Operand) -> Value:
    difference = _sub(context, x, y)
    return difference.positive.add(difference.negated().positive)


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


@rule("abs")
def _abs(context: Context, x: Value) -> Value:
    return _sub(context, x.relu.scaled(-1), x)


@rule("select_n")
def _select(context: Context, which: Operand, *cases: Operand) -> Value:
    if not isinstance(which, Value):
        aligned = _side_by_side(context, cases)
        chosen = lax.select_n_p.bind(which, *[case.share for case in aligned])
        return Value(context, aligned[0].frac_bits, share=chosen)
    if len(cases) != 2:
        raise Unsupported(f"a secret index selects among {len(cases)} cases; only two are supported")
    on_false, on_true = cases
    if isinstance(on_true, Value) and _is_zero(on_false):
        return which.times(on_true)
    bits = context.protocol.frac_bits
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
