"""The best plan for what is known, beside independent numbers."""

import numpy as np
import pytest

from ciphernav_jax.world.grid import CELLS, WALLS
from ciphernav_jax.world.planner import paths
from experiments.paper import bounds

RING = 11


@pytest.fixture(scope="module")
def cases():
    return bounds.cases()


def test_all_scenarios_are_there_and_their_probabilities_add_up(cases):
    assert len(cases) == 2 * 58_892  # of the fact sheet, with two headings each
    for half in (True, False):
        assert sum(weight for *_, detour, weight in cases if detour == half) == pytest.approx(0.5)


def test_plans_of_the_ring_go_either_way_round():
    assert set(bounds.plans(RING, 2)) == {frozenset({0, 1, 2}), frozenset(np.flatnonzero(~WALLS[RING])) - {1}}


def test_knowing_all_is_enough_and_knowing_the_map_is_not(cases):
    assert bounds.best(cases, bounds.KNOWN["map and all obstacles"])["overall"] == pytest.approx(100)
    known = bounds.best(cases, bounds.KNOWN["map"])
    # A sampled estimate of an independent implementation: 78.2 / 73.7, mean 76.0.
    assert known["overall"] == pytest.approx(76.0, abs=1)
    assert known["detour"] > known["no_detour"]


def test_seen_pairs_do_not_come_up_and_can_be_ruled_out(cases):
    # Of the ring no scenario is left but those with one obstacle, beside the start.
    ring = [case for case in cases if case[0] == RING]
    blocked = frozenset([1])
    seen = {(RING, sum(1 << cell for cell in case[3])) for case in ring if case[3] != blocked}
    left = bounds.cases(seen)
    assert {case[3] for case in left if case[0] == RING} == {blocked}
    assert {case for case in left if case[0] != RING}.isdisjoint(cases)  # the same, likelier
    assert len(left) == len(cases) - len(ring) + sum(case[3] == blocked for case in ring)
    for half in (True, False):
        assert sum(weight for *_, detour, weight in left if detour == half) == pytest.approx(0.5)
    of_ring = [case for case in left if case[0] == RING]
    possible = sum(weight for *_, weight in of_ring)
    won = bounds.best(of_ring, bounds.KNOWN["map"])["overall"]
    assert won == pytest.approx(100 * possible)


def test_the_label_path_is_among_the_plans():
    for layout in range(len(WALLS)):
        for goal, moves in paths(WALLS[layout]).items():
            assert min(map(len, bounds.plans(layout, goal))) == len(moves) + 1
    assert CELLS == 25
