"""Data movement: the same operation on the shares."""

import itertools
import math
from collections.abc import Callable
from contextlib import nullcontext
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, lax

from ciphernav_jax import ring
from ciphernav_jax.jax_private import Primitive
from ciphernav_jax.secret import bounds
from ciphernav_jax.secret.rules.operands import Operand, frac_bits_at_rest, to_value
from ciphernav_jax.secret.rules.registry import Rule, Unsupported, rule
from ciphernav_jax.secret.scaling import from_public, is_float
from ciphernav_jax.secret.value import Context, Move, Value, join


def moves(
    primitive: Primitive, data_operands: int | None = None, back: Callable[..., Move] | None = None
) -> None:
    """Registers a primitive that only moves entries: applied to the shares as it is.

    The first `data_operands` operands are data (all if None); the rest are indices, which must be public.
    `back(shape, **params)` undoes it, for results of operands of that shape and as many entries.
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
        return data[0].moved(bound, back and back(data[0].shape, **params))

    rule(primitive.name, moves=True)(move)


def _reshaped(shape: tuple[int, ...], /, **_: Any) -> Move:
    return partial(jnp.reshape, shape=shape)


for _primitive in (lax.concatenate_p, lax.pad_p, lax.slice_p, lax.stack_p, lax.tile_p):
    moves(_primitive)
for _primitive in (lax.broadcast_in_dim_p, lax.copy_p, lax.reshape_p, lax.squeeze_p):
    moves(_primitive, back=_reshaped)
moves(lax.rev_p, back=lambda _, /, dimensions: partial(lax.rev, dimensions=dimensions))
moves(
    lax.transpose_p,
    back=lambda _, /, permutation: partial(jnp.transpose, axes=tuple(map(int, np.argsort(permutation)))),
)
moves(lax.dynamic_slice_p, data_operands=1)
moves(lax.dynamic_update_slice_p, data_operands=2)


@rule("split", moves=True)
def _split(context: Context, x: Value, *, sizes: tuple[int, ...], axis: int) -> list[Value]:
    ends = list(itertools.accumulate(sizes))
    return [
        x.moved(partial(lax.slice_in_dim, start_index=end - size, limit_index=end, axis=axis))
        for size, end in zip(sizes, ends, strict=True)
    ]


@rule("unstack", moves=True)
def _unstack(context: Context, x: Value, *, axis: int) -> list[Value]:
    return [
        x.moved(partial(lax.index_in_dim, index=i, axis=axis, keepdims=False)) for i in range(x.shape[axis])
    ]


@rule("stop_gradient", moves=True)
def _identity(context: Context, x: Value) -> Value:
    return x


@rule("gather", moves=True)
def _gather(context: Context, x: Operand, indices: Operand, *, fill_value: Any, **params: Any) -> Value:
    if isinstance(indices, Value) or not isinstance(x, Value):
        raise Unsupported("the indices are secret; gather takes public indices")
    if params["mode"] != lax.GatherScatterMode.FILL_OR_DROP:
        return x.moved(lambda share: lax.gather_p.bind(share, indices, fill_value=None, **params))

    def read(filled_with: Any, x: Array) -> Array:
        return lax.gather_p.bind(x, indices, fill_value=filled_with, **params)

    dtype = context.result.dtype
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


def scatter_into(scatter: Callable[..., Array]) -> Rule:
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


rule("scatter", moves=True)(scatter_into(lax.scatter))
rule("scatter-add")(scatter_into(lax.scatter_add))
