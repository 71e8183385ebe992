import itertools
from typing import NamedTuple

import numpy as np
import pytest

from ciphernav_jax.world import dataset, grid, planner, scenario


class Everything(NamedTuple):
    """All that can be drawn: P pairs of layout and obstacle cells, and every goal in each."""

    blocked: np.ndarray  # bool[P, 25], walls and obstacles
    weight: np.ndarray  # float64[P, 25], the natural probability of each goal, 0 where there is none
    length: np.ndarray  # int[P, 25], moves of the shortest path
    detour: np.ndarray  # bool[P, 25]


@pytest.fixture(scope="session")
def everything() -> Everything:
    rows = []
    for layout, walls in enumerate(grid.WALLS):
        without = planner.paths(walls)
        for count, likely in enumerate(scenario.COUNT_PROBABILITIES, start=1):
            choices = list(itertools.combinations(scenario.OBSTACLE_CELLS, count))
            for cells in choices:
                blocked = walls.copy()
                blocked[list(cells)] = True
                found = planner.paths(blocked)
                if len(found) < 2:
                    continue
                weight, length, detour = np.zeros(25), np.zeros(25, int), np.zeros(25, bool)
                for goal, moves in found.items():
                    weight[goal] = grid.LAYOUT_PROBABILITIES[layout] * likely / len(choices) / len(found)
                    length[goal] = len(moves)
                    detour[goal] = moves != without[goal]
                rows.append((blocked, weight, length, detour))
    return Everything(*map(np.stack, zip(*rows, strict=True)))


@pytest.fixture(scope="session")
def arguments():
    """What decides a data set of two shards, the second a short one."""
    return {"split": "train", "count": 130, "seed": 0}


@pytest.fixture(scope="session")
def small_folder(arguments, tmp_path_factory):
    out = tmp_path_factory.mktemp("world") / "small"
    dataset.generate(**arguments, out=out, workers=2, progress=False)
    return out


@pytest.fixture(scope="session")
def small(small_folder) -> dataset.Dataset:
    return dataset.load(small_folder)
