import functools
import operator

import numpy as np
import pytest

from ciphernav_jax import ring
from ciphernav_jax.parties.party import from_party_zero
from ciphernav_jax.protocols import adders

from ..parties.simulated import elements, on_shares, words
from ..slow import slow

ADDERS = ["carry-tree", "kogge-stone", "brent-kung", "ripple"]
WIDTHS = [1, 2, 3, 5, 20, 31, 32, 63, 64]


@pytest.mark.parametrize("width", WIDTHS)
@pytest.mark.parametrize("adder", ADDERS)
def test_a_network_joins_neighbouring_groups_until_the_carries_are_whole(adder, width):
    groups = {i: range(i, i + 1) for i in range(width)}
    with_p = set(range(width))
    for level in adders.network(adder, width):
        joined = {}
        for i in level.targets:
            low = i - level.distance
            assert groups[low].stop == groups[i].start  # neighbours: nothing is left out or counted twice
            assert i in with_p
            assert low in with_p or not level.propagate
            joined[i] = range(groups[low].start, groups[i].stop)
        groups |= joined
        with_p = with_p - set(level.targets) if not level.propagate else with_p
    complete = [i for i in groups if groups[i] == range(i + 1)]
    assert width - 1 in complete
    assert adder == "carry-tree" or complete == list(range(width))


@pytest.mark.parametrize(
    ("adder", "levels", "conjunctions"),
    [("carry-tree", 6, 125), ("kogge-stone", 6, 610), ("brent-kung", 11, 182), ("ripple", 63, 63)],
)
def test_a_network_has_the_levels_and_conjunctions_of_the_table(adder, levels, conjunctions):
    network = adders.network(adder, 64)
    assert len(network) == levels
    assert sum(len(level.targets) * (1 + level.propagate) for level in network) == conjunctions
    assert f"| `{adder}` | {levels} | {conjunctions} |" in str(adders.__doc__)


@functools.cache
def additions(layout, adder, width):
    """The carries of a + b, whose bits party 0 knows; by exclusive or of the shares."""

    def program(dealer, a, b):
        del a, b
        left, right = words(1, 256), words(2, 256)
        g, p = (from_party_zero(np.asarray(x)) for x in (left & right, left ^ right))
        if layout == "words":
            return adders.carries_in_words(dealer, g, p, adder, width)
        return adders.carries(dealer, ring.bit_slice(g)[:width], ring.bit_slice(p)[:width], adder)

    return program


@pytest.mark.parametrize("width", [1, 5, *slow(20, 64)])
@pytest.mark.parametrize("adder", ADDERS)
@pytest.mark.parametrize("layout", ["sliced", "words"])
def test_carries_are_those_of_the_addition(layout, adder, width):
    a, b = words(1, 256), words(2, 256)
    shares = on_shares(additions(layout, adder, width), 3)(3, a, b)
    got = functools.reduce(operator.xor, np.asarray(shares))
    carries = np.zeros(256, object)
    for i in range(width):
        low = 2 ** (i + 1)
        out = [(int(x) % low + int(y) % low) // low << i for x, y in zip(a, b, strict=True)]
        carries += np.array(out, object)
    if layout == "sliced":
        rows = np.zeros((64, got.shape[1]), np.uint64)
        rows[width - len(got) : width] = got
        got = np.asarray(ring.bit_unslice(rows, (256,)))
    wanted = [width - 1] if adder == "carry-tree" else range(width)
    positions = np.uint64(sum(1 << i for i in wanted))
    np.testing.assert_array_equal(np.asarray(got) & positions, elements(carries) & positions)
