"""Carries and borrows: the prefix networks of binary adders, on bits shared by exclusive or.

Position i of an addition *generates* a carry (g_i) or *propagates* one (p_i). Neighbouring groups of
positions combine as

    (g, p) = (g_high ^ p_high g_low, p_high p_low),

and the carry out of position i is the g of the group 0..i. A network says in which order groups combine: it
is a list of levels, and at each level some positions take in the group that ends a fixed distance below them.
A level costs one opening; a p that no later level uses is not computed.

| adder | levels for 64 positions | conjunctions for each value | gives |
|---|---|---|---|
| `carry-tree` | 6 | 125 | the last carry alone |
| `kogge-stone` | 6 | 610 | all carries (Kogge and Stone, IEEE ToC 1973) |
| `brent-kung` | 11 | 182 | all carries (Brent and Kung, IEEE ToC 1982) |
| `ripple` | 63 | 63 | all carries; for reference |
"""

from collections.abc import Sequence
from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import UInt64

from ciphernav_jax.parties.dealer import Dealer
from ciphernav_jax.protocols.multiply import conjunction
from ciphernav_jax.protocols.suite import Adder


@dataclass(frozen=True)
class Level:
    """The positions `targets` take in the groups that end `distance` below them, all at once.

    `propagate` says whether their p is needed afterwards.
    """

    distance: int
    targets: tuple[int, ...]
    propagate: bool

    @property
    def used(self) -> set[int]:
        """The positions that take part."""
        return {i - below for i in self.targets for below in (0, self.distance)}


def network(adder: Adder, width: int) -> tuple[Level, ...]:
    """The levels that give the carry out of the last position; but for "carry-tree" out of all others too."""
    distances = [1 << k for k in range((width - 1).bit_length())]
    top = width - 1
    match adder:
        case "carry-tree":
            steps = [(d, range(top, d - 1, -2 * d)) for d in distances]
        case "kogge-stone":
            steps = [(d, range(d, width)) for d in distances]
        case "brent-kung":
            up = [(d, range(2 * d - 1, width, 2 * d)) for d in distances]
            down = [(d, range(3 * d - 1, width, 2 * d)) for d in reversed(distances)]
            steps = up + down
        case "ripple":
            steps = [(1, range(i, i + 1)) for i in range(1, width)]
    levels: list[Level] = []
    needed: set[int] = set()  # positions whose p a later level uses
    for distance, positions in reversed([(d, sorted(t)) for d, t in steps if t]):
        propagate = not needed.isdisjoint(positions)
        levels.insert(0, Level(distance, tuple(positions), propagate))
        needed |= set(positions)
        if propagate:
            needed |= {i - distance for i in positions}
    return tuple(levels)


def carries(
    dealer: Dealer, g: UInt64[Array, "w b"], p: UInt64[Array, "w b"], adder: Adder
) -> UInt64[Array, "v b"]:
    """The carry out of each of w positions, sliced (64 values to a word); of the last alone for "carry-tree".

    Opened: masked words of g and p at each level, uniform. Rounds: the levels of the table above. Correlated
    randomness: an `AndTriple` for each level. Error: none.
    """
    levels = network(adder, len(g))
    wanted = {len(g) - 1} if adder == "carry-tree" else set(range(len(g)))
    held = list(range(len(g)))  # the positions of the rows of g and p
    for n, level in enumerate(levels):
        sources = [i - level.distance for i in level.targets]
        low = [_rows(g, held, sources)] + ([_rows(p, held, sources)] if level.propagate else [])
        high = [_rows(g, held, level.targets), _rows(p, held, level.targets)]
        product = conjunction(dealer, high[1], jnp.stack(low))
        later = wanted.union(*(level.used for level in levels[n + 1 :]))
        kept = [i for i in held if i in later and i not in level.targets]
        g = jnp.concatenate([_rows(g, held, kept), high[0] ^ product[0]])
        p = jnp.concatenate([_rows(p, held, kept), product[1] if level.propagate else high[1]])
        held = [*kept, *level.targets]
    return _rows(g, held, sorted(wanted))


def carries_in_words(
    dealer: Dealer, g: UInt64[Array, "..."], p: UInt64[Array, "..."], adder: Adder, width: int
) -> UInt64[Array, "..."]:
    """As `carries`, for values that keep their bits in a word of their own: bit i of the result is the carry
    out of position i. A conjunction then takes whole words, whatever the number of positions it is needed
    for.
    """
    for level in network(adder, width):
        targets = np.uint64(sum(1 << i for i in level.targets))
        low = [g << level.distance] + ([p << level.distance] if level.propagate else [])
        product = conjunction(dealer, p, jnp.stack(low))
        g = g ^ (product[0] & targets)
        if level.propagate:
            p = (p & ~targets) | (product[1] & targets)
    return g


def _rows(x: UInt64[Array, "w b"], held: Sequence[int], positions: Sequence[int]) -> UInt64[Array, "v b"]:
    """The rows of the given positions; a slice where they are evenly spaced."""
    rows = [held.index(position) for position in positions]
    steps = set(np.diff(rows))
    if len(steps) > 1 or min(steps, default=1) < 0:
        return x[np.array(rows)]
    return x[rows[0] : rows[-1] + 1 : min(steps, default=1)] if rows else x[:0]
