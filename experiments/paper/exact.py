"""The exact attack on masks that are used twice: is a hidden value the difference, or the sum, of two words?

Two values x and y under one mask r are seen as x - r and y - r: the words' difference is that of the values,
and tells one of them where the other is public. Or the mask itself is seen, or its negative. All these are
equations between two words modulo 2^64, each with or without what it hides. A sort finds them, over all pairs
of words. Two words agree by chance once in 2^64 pairs.

Nothing is learned here, and nothing overlooked; but only what two words tell is found. What three tell, and
what goes together without being equal, is left to the attackers that learn (`attack`).
"""

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from experiments.paper.attack import Words

FOUND = ("words", "read", "compared", "repeated")
PART = 2**27  # numbers that are sorted together


class Sight(NamedTuple):
    """Words that an attacker sees.

    Attributes:
        name: what they are.
        words: uint64, of any shape.
        hidden: uint64 of the same shape, what they are shares of; None of other words: dealt, sent, opened.
        public: whether the attacker knows what is hidden.
    """

    name: str
    words: Words
    hidden: Words | None = None
    public: bool = False


def attack(sights: Sequence[Sight]) -> dict[str, dict[str, int]]:
    """Look at all pairs of words.

    Args:
        sights: all that is seen; their names differ.

    Returns:
        By name: words, how many there are; read, how many hidden values are the sum or the difference of two
        seen words (from shares of public values these are subtracted), or are seen as they are; compared,
        of how many hidden values the sum with another one, or the difference to it, is that of two seen
        words; repeated, how many words are seen elsewhere too, or their negatives are.
    """
    # A value that stands unmasked is its difference to the word 0.
    sights = [Sight("", np.zeros(1, np.uint64)), *sights]
    twice = _twice(sights)
    sizes = [sight.words.size for sight in sights]
    ends = np.cumsum(sizes)

    # What stays are groups of equal ones, at least two in each.
    begins = ends - sizes
    found = [_Numbers.of(sight, begin, twice) for sight, begin in zip(sights, begins, strict=True)]
    numbers = _Numbers(*(np.concatenate(column) for column in zip(*found, strict=True)))
    order = np.argsort(numbers.value, kind="stable")
    value, place, plain, asked, known = (column[order] for column in numbers)
    starts = np.flatnonzero(np.append(True, value[1:] != value[:-1])) if len(value) else place

    def count(found: NDArray[np.bool_]) -> NDArray[np.int64]:
        return np.bincount(np.searchsorted(ends, np.unique(place[found]), "right"), minlength=len(sizes))

    counts = {
        "words": np.asarray(sizes),
        "read": count(asked & _meets(known, place, starts)),
        "compared": count(asked & _meets(asked, place, starts)),
        "repeated": count(plain & _meets(plain, place, starts)),
    }
    return {
        sight.name: {what: int(number[i]) for what, number in counts.items()}
        for i, sight in enumerate(sights)
        if i
    }


class _Numbers(NamedTuple):
    """Numbers that are seen more than once.

    Attributes:
        value: uint64[n].
        place: int64[n], where the word stands among all.
        plain: bool[n], whether as it is seen, and not without what it hides.
        asked: bool[n], whether it stands for a hidden value that is asked for.
        known: bool[n], whether it tells what is equal to it.
    """

    value: NDArray[Any]
    place: NDArray[Any]
    plain: NDArray[Any]
    asked: NDArray[Any]
    known: NDArray[Any]

    @classmethod
    def of(cls, sight: Sight, begin: int, twice: Words) -> "_Numbers":
        """Those of a sight whose first word stands at `begin`."""
        secret = sight.hidden is not None and not sight.public
        found = []
        for values, places, plain in _seen(sight):
            at = np.flatnonzero(_among(values, twice))
            flags = np.full(len(at), plain)
            bare = flags if sight.hidden is None else _flat(sight.hidden)[places[at]] == 0
            asked = (bare | ~flags) if secret else np.zeros_like(flags)
            found.append(cls(values[at], begin + places[at], flags, asked, flags | (not secret)))
        return cls(*(np.concatenate(column) for column in zip(*found, strict=True)))


def _seen(sight: Sight) -> Iterator[tuple[Words, NDArray[np.int64], bool]]:
    """Each word as it is seen, and without what it hides: x - y = a - b where x - a = y - b. And negated,
    for sums. With the places of the words, and whether they stand as they are seen.
    """
    words = _flat(sight.words)
    seen = [(words, np.arange(words.size), True)]
    if sight.hidden is not None:
        hidden = _flat(sight.hidden)
        masking = np.flatnonzero(hidden != 0)
        seen.append((words[masking] - hidden[masking], masking, False))
    for values, places, plain in seen:
        yield values, places, plain
        yield np.zeros_like(values) - values, places, plain


def _flat(words: Words) -> Words:
    return np.asarray(words).reshape(-1)


def _twice(sights: Sequence[Sight]) -> Words:
    """The numbers that are there more than once, in order. They are looked for in parts, by their first bits,
    as all of them together would not fit into memory.
    """
    bits = max(4 * sum(sight.words.size for sight in sights) // PART, 1).bit_length()
    found = []
    for part in range(2**bits):
        values = [v[v >> np.uint64(64 - bits) == part] for sight in sights for v, _, _ in _seen(sight)]
        ordered = np.sort(np.concatenate(values))
        found.append(np.unique(ordered[1:][ordered[1:] == ordered[:-1]]))
    return np.concatenate(found)


def _among(values: Words, few: Words) -> NDArray[np.bool_]:
    """Which of the values are among a few, which stand in order."""
    if not len(few):
        return np.zeros(len(values), bool)
    return few[np.searchsorted(few, values).clip(max=len(few) - 1)] == values


def _meets(role: NDArray[np.bool_], place: NDArray[np.int64], starts: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Whether in its group, from one start to the next, another place has that role."""
    if not len(place):
        return role
    low = np.minimum.reduceat(np.where(role, place, place.max() + 1), starts)
    high = np.maximum.reduceat(np.where(role, place, -1), starts)
    sizes = np.diff(np.append(starts, len(place)))
    low, high = np.repeat(low, sizes), np.repeat(high, sizes)
    return (low <= high) & ((low != place) | (high != place))
