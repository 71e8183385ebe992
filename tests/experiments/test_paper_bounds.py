"""The best plan for what is known, beside independent numbers."""

import numpy as np
import pytest

from ciphernav_jax.experiments.paper import bounds
from ciphernav_jax.world.grid import CELLS, WALLS
from ciphernav_jax.world.planner import paths

RING = 11


@pytest.fixture(scope="module")
def cases():
    return list(bounds.cases())


def test_all_scenarios_are_there_and_their_probabilities_add_up(cases):
    assert len(cases) == 2 * 58_892  # of the fact sheet, with two headings each
    for half in (True, False):
        assert sum(weight for *_, detour, weight in cases if detour == half) == pytest.approx(0.5)


def test_plans_of_the_ring_go_either_way_round():
    assert set(bounds.plans(RING, 2)) == {frozenset({0, 1, 2}), frozenset(np.flatnonzero(~WALLS[RING])) - {1}}


def test_knowing_all_is_enough_and_knowing_the_map_is_not():
    assert bounds.best(bounds.KNOWN["map and all obstacles"])["overall"] == pytest.approx(100)
    known = bounds.best(bounds.KNOWN["map"])
    # A sampled estimate of an independent implementation: 78.2 / 73.7, mean 76.0.
    assert known["overall"] == pytest.approx(76.0, abs=1)
    assert known["detour"] > known["no_detour"]


def test_the_label_path_is_among_the_plans():
    for layout in range(len(WALLS)):
        for goal, moves in paths(WALLS[layout]).items():
            assert min(map(len, bounds.plans(layout, goal))) == len(moves) + 1
    assert CELLS == 25
