import numpy as np
import pytest

from ciphernav_jax.world import grid, planner


def distances(blocked):
    """Moves from the start to every cell, by relaxation; an implementation of its own."""
    free = ~blocked.reshape(5, 5)
    best = np.full((7, 7), np.inf)
    best[1, 1] = 0
    for _ in range(25):
        inner = best[1:-1, 1:-1]
        around = np.minimum.reduce([best[:-2, 1:-1], best[2:, 1:-1], best[1:-1, :-2], best[1:-1, 2:]])
        inner[free] = np.minimum(inner, around + 1)[free]
    return best[1:-1, 1:-1].reshape(-1)


@pytest.mark.parametrize("layout", range(12))
@pytest.mark.parametrize("obstacles", [[], [1], [10, 22], [2, 14, 23]])
def test_paths_are_shortest_and_walkable(layout, obstacles):
    blocked = grid.WALLS[layout].copy()
    blocked[obstacles] = True
    expected = distances(blocked)
    found = planner.paths(blocked)
    assert set(found) == set(np.flatnonzero(np.isfinite(expected))) - {grid.START}
    for goal, moves in found.items():
        cell = grid.START
        for action in moves:
            cell = int(grid.move(cell, action))
            assert cell >= 0
            assert not blocked[cell]
        assert cell == goal
        assert len(moves) == expected[goal]


def test_ties_are_settled_right_first_then_down():
    ring = grid.WALLS[11]
    assert planner.paths(ring)[24] == (4, 4, 4, 4, 2, 2, 2, 2)
    nothing = np.zeros(25, bool)
    assert planner.paths(nothing)[6] == (4, 2)


def test_a_reroute_of_equal_length_is_a_detour():
    obstacles = np.zeros(25, bool)
    obstacles[4] = True
    assert planner.paths(grid.WALLS[11] | obstacles)[24] == (2, 2, 2, 2, 4, 4, 4, 4)
    assert planner.needs_detour(grid.WALLS[11], obstacles, 24)
    assert not planner.needs_detour(grid.WALLS[11], obstacles, 20)


def test_labels_end_with_a_stop():
    assert planner.labels((4, 2)).tolist() == [4, 2, 0] + [-1] * 14
    assert planner.labels((1,) * 16).tolist() == [1] * 16 + [0]
    with pytest.raises(ValueError, match="do not fit into 17 actions"):
        planner.labels((1,) * 17)


def test_the_guide_leads_from_the_start_along_the_path_and_from_everywhere_by_as_short_a_one():
    rng = np.random.default_rng(0)
    for layout in range(12):
        blocked = grid.WALLS[layout].copy()
        blocked[rng.choice([2, 9, 14, 21, 10], 2, replace=False)] = True
        found = planner.paths(blocked)
        goals = np.array(list(found))
        worlds = np.repeat(blocked[None], len(goals), axis=0)
        actions, moves = planner.guide(worlds, goals), planner.distances(worlds, goals)
        for goal, row, distance in zip(goals.tolist(), actions, moves, strict=True):
            cell, walked = grid.START, []
            while row[cell] > 0:
                walked.append(int(row[cell]))
                cell = int(grid.move(cell, row[cell]))
            assert cell == goal
            assert tuple(walked) == found[goal]
            assert (row[blocked] == planner.NO_LABEL).all()
            away = distances_to(blocked, goal)
            for start in np.flatnonzero(row > 0):
                assert away[grid.move(start, row[start])] == away[start] - 1
            assert (np.isinf(away) == (row == planner.NO_LABEL)).all()
            np.testing.assert_array_equal(distance, np.where(np.isinf(away), planner.FAR, away))


def distances_to(blocked, goal):
    """Moves from every cell to the goal, by relaxation."""
    best = np.full(25, np.inf)
    best[goal] = 0
    for _ in range(25):
        for cell in np.flatnonzero(~blocked):
            around = [int(grid.move(cell, action)) for action in range(1, 5)]
            best[cell] = min(best[cell], *(best[a] + 1 for a in around if a >= 0 and not blocked[a]), np.inf)
    return best
