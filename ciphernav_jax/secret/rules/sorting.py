"""The largest and the smallest of n entries, and where it stands.

- A tournament: neighbours are compared, then the winners, ceil(log2 n) comparisons deep and n - 1 in all.
  Each level is compiled for itself. So where there are many, the last ones all get the width of the first of
  them and run in one loop: a few comparisons more, and a program whose size does not grow with n.
- All pairs at once: two comparisons deep, n (n - 1) / 2 in all. For the index of few entries.
"""

from typing import Any

import jax.numpy as jnp
import numpy as np
from jax import Array

from ciphernav_jax.secret.rules.comparisons import logical_not
from ciphernav_jax.secret.rules.control_flow import repeated
from ciphernav_jax.secret.rules.operands import Operand
from ciphernav_jax.secret.rules.registry import rule
from ciphernav_jax.secret.scaling import dot_public, from_public, times_constant
from ciphernav_jax.secret.value import Context, Value, join, where

MOST_PAIRS = 300
"""With more pairs than this, an arg max that is left to choose takes a tournament."""

UNROLLED = 6
"""Levels of a long tournament that are compiled each for itself."""


def _tournament(context: Context, players: list[Value]) -> list[Value]:
    """The winner of the first of the values, along its leading axis, and what stands at its place in the
    others. Of equals the first.
    """
    levels = (players[0].shape[0] - 1).bit_length()
    unrolled = levels if levels <= UNROLLED + 2 else UNROLLED
    for _ in range(unrolled):
        players = _games(context, players)
    if unrolled < levels:
        even = (players[0].shape[0] + 1) // 2 * 2
        players = repeated(context, _games_of_one_width, _filled(players, even), levels - unrolled)
    return [x.moved(lambda share: share[0]) for x in players]


def _games(context: Context, players: list[Value]) -> list[Value]:
    """One level: the winners of neighbours; of an odd number the last goes on by itself."""
    even = players[0].shape[0] // 2 * 2
    lower, upper, rest = (
        [x.moved(lambda share, part=part: share[part]) for x in players]
        for part in (slice(0, even, 2), slice(1, even, 2), slice(even, None))
    )
    difference = upper[0].compared(lower[0])
    winners = [lower[0].like(difference.relu.add(lower[0]).share)]
    for a, b in zip(lower[1:], upper[1:], strict=True):
        winners.append(a.like(where(difference.positive, b, a).share))
    if rest[0].shape[0] == 0:
        return winners
    return [join(lambda *shares: jnp.concatenate(shares), *pair) for pair in zip(winners, rest, strict=True)]


def _filled(players: list[Value], width: int) -> list[Value]:
    """As many players as `width`, by repeating the last, who beats nobody of before."""

    def fill(share: Array) -> Array:
        return share[np.minimum(np.arange(width), share.shape[0] - 1)]

    return [x.moved(fill) for x in players]


def _games_of_one_width(context: Context, players: list[Value]) -> list[Value]:
    return _filled(_games(context, players), players[0].shape[0])


@rule("reduce_max")
def _largest(context: Context, x: Value, *, axes: tuple[int, ...], **_: Any) -> Operand:
    if 0 in x.shape:
        return np.full(np.delete(x.shape, axes), _ends(context.result.dtype)[0], context.result.dtype)
    return _winner(context, x, axes)


@rule("reduce_min")
def _smallest(context: Context, x: Value, *, axes: tuple[int, ...], **_: Any) -> Operand:
    if 0 in x.shape:
        return np.full(np.delete(x.shape, axes), _ends(context.result.dtype)[1], context.result.dtype)
    return _winner(context, x.negated(), axes).negated()


def _winner(context: Context, x: Value, axes: tuple[int, ...]) -> Value:
    def front(share: Array) -> Array:
        share = jnp.moveaxis(share, axes, range(len(axes)))
        return share.reshape(-1, *share.shape[len(axes) :])

    return _tournament(context, [x.settled.moved(front)])[0]


def _ends(dtype: np.dtype) -> tuple[Any, Any]:
    """The largest and the smallest entry of nothing, as in JAX."""
    if jnp.issubdtype(dtype, np.floating):
        return -np.inf, np.inf
    return np.iinfo(dtype).min, np.iinfo(dtype).max


@rule("argmax")
def _argmax(context: Context, x: Value, *, axes: tuple[int, ...], **_: Any) -> Value:
    """The index of the largest entry, the first of equals, without opening anything but masked words."""
    (axis,) = axes
    n = x.shape[axis]
    if n == 1 or 0 in x.shape:
        return from_public(context, np.zeros(np.delete(x.shape, axis), np.int64))
    variant = context.protocol.argmax
    if variant == "pairwise" or (variant == "auto" and n * (n - 1) // 2 <= MOST_PAIRS):
        return _pairwise(context, x.moved(lambda share: jnp.moveaxis(share, axis, -1)))
    entries = x.settled.moved(lambda share: jnp.moveaxis(share, axis, 0))
    numbers = np.arange(n).reshape(n, *[1] * (len(entries.shape) - 1))
    return _tournament(context, [entries, from_public(context, np.broadcast_to(numbers, entries.shape))])[1]


@rule("argmin")
def _argmin(context: Context, x: Value, **params: Any) -> Value:
    return _argmax(context, x.negated(), **params)


def _pairwise(context: Context, x: Value) -> Value:
    """Every pair is compared at once; who wins n - 1 times is the largest: two comparisons deep."""
    n = x.shape[-1]
    low, high = np.triu_indices(n, 1)
    earlier, later = (x.moved(lambda share, i=i: share[..., i]) for i in (low, high))
    later_wins = later.compared(earlier).positive
    lost = np.zeros((len(low), n), np.int64)
    lost[np.arange(len(low)), low] = 1
    lost[np.arange(len(low)), high] = -1
    # An entry loses to the later ones that are larger, and to the earlier ones unless it is itself larger.
    contract = (((later_wins.share.ndim - 1,), (0,)), ((), ()))
    losses = dot_public(context, later_wins, lost, contract, public_left=False)
    beaten = losses.add(from_public(context, np.arange(n))).positive
    index = times_constant(logical_not(context, beaten), np.arange(n))
    return index.summed(n, lambda share: jnp.sum(share, axis=-1, dtype=jnp.uint64))
