"""The exact attack on masks that are used twice: is a hidden value the difference, or the sum, of two words?

Two values x and y under one mask r are seen as x - r and y - r: the words' difference is that of the values,
and tells one of them where the other is public. Or the mask itself is seen, or its negative. All these are
equations between two words modulo 2^64, each with or without what it hides. A sort finds them, over all pairs
of words. Two words agree by chance once in 2^64 pairs.

Nothing is learned here, and nothing overlooked; but only what two words tell is found. What three tell, and
what goes together without being equal, is left to the attackers that learn (`attack`).
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ciphernav_jax.experiments.paper.attack import Words

FOUND = ("words", "read", "compared", "repeated")


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
    sizes = [sight.words.size for sight in sights]
    words = _flat([sight.words for sight in sights])
    hidden = _flat([np.zeros_like(s.words) if s.hidden is None else s.hidden for s in sights])
    secret = np.repeat([s.hidden is not None and not s.public for s in sights], sizes)

    # Each word as it is seen, and without what it hides: x - y = a - b where x - a = y - b. And negated,
    # for sums.
    masking = np.flatnonzero(hidden != 0)
    left = np.concatenate([words, words[masking] - hidden[masking]])
    left = np.concatenate([left, np.zeros_like(left) - left])

    # What stays are groups of equal ones, at least two in each.
    of = _again(left)
    starts = np.flatnonzero(np.append(True, left[of[1:]] != left[of[:-1]])) if len(of) else of
    of %= len(left) // 2
    plain = of < len(words)
    place = of.copy()
    place[~plain] = masking[of[~plain] - len(words)]
    asked = secret[place] & (~plain | (hidden[place] == 0))
    known = plain | ~secret[place]

    ends = np.cumsum(sizes)

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


def _flat(arrays: Sequence[Words]) -> Words:
    return np.concatenate([np.asarray(x).reshape(-1) for x in arrays])


def _again(words: Words) -> NDArray[np.int64]:
    """Where the words stand that are there more than once, equal ones together."""
    ordered = np.sort(words)  # to sort places would take three times as long and as much memory
    twice = np.unique(ordered[1:][ordered[1:] == ordered[:-1]])
    if not len(twice):
        return np.zeros(0, np.int64)
    found = np.flatnonzero(twice[np.searchsorted(twice, words).clip(max=len(twice) - 1)] == words)
    return found[np.argsort(words[found], kind="stable")]


def _meets(role: NDArray[np.bool_], place: NDArray[np.int64], starts: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Whether in its group, from one start to the next, another place has that role."""
    if not len(place):
        return role
    low = np.minimum.reduceat(np.where(role, place, place.max() + 1), starts)
    high = np.maximum.reduceat(np.where(role, place, -1), starts)
    sizes = np.diff(np.append(starts, len(place)))
    low, high = np.repeat(low, sizes), np.repeat(high, sizes)
    return (low <= high) & ((low != place) | (high != place))
