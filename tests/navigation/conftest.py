"""A small Obstacle World without a renderer: a view is five bars that show the obstacles of a lane."""

from collections.abc import Iterator

import jax
import numpy as np
import pytest

from ciphernav_jax.world import planner, scenario
from ciphernav_jax.world.dataset import Dataset
from ciphernav_jax.world.grid import CELLS, SIDE, WALLS, move

LANES = [range(0, CELLS, SIDE), range(20, CELLS), range(SIDE), range(4, CELLS, SIDE)]


class Album:
    """Distinct views, each with its number."""

    def __init__(self):
        self.numbers: dict[tuple, int] = {}

    def add(self, bits: tuple) -> int:
        return self.numbers.setdefault(bits, len(self.numbers))

    def views(self) -> np.ndarray:
        bars = np.array([np.resize(bits, SIDE) for bits in self.numbers], np.uint8)
        row = np.repeat(bars * 200, 60 // SIDE, axis=1)
        return np.broadcast_to(row[:, None, :, None], (len(bars), 45, 60, 3)).copy()


def line(walls: np.ndarray, cell: int, heading: int) -> Iterator[int]:
    """The cells straight ahead of a cell, up to a wall or the edge; walls are bool[25]."""
    while (cell := int(move(cell, heading + 1))) >= 0 and not walls[cell]:
        yield cell


def ahead(cell: int, heading: int, drawn: scenario.Scenario) -> tuple:
    seen = [bool(drawn.obstacle_cells[there]) for there in line(drawn.walls, cell, heading)]
    return tuple(seen + [False] * (SIDE - len(seen)))


def make(count: int, seed: int) -> Dataset:
    rng = np.random.default_rng(seed)
    drawn = [scenario.draw(rng, detour=bool(index % 2)) for index in range(count)]
    album = Album()
    cameras = [[album.add(tuple(bool(s.obstacle_cells[c]) for c in lane)) for lane in LANES] for s in drawn]
    agent = [
        [
            [-1 if s.blocked[c] else album.add(ahead(c, heading, s)) for heading in range(4)]
            for c in range(CELLS)
        ]
        for s in drawn
    ]
    return Dataset(
        views=album.views(),
        cameras=np.array(cameras, np.int32),
        agent=np.array(agent, np.int32),
        layout=np.array([s.layout for s in drawn], np.uint8),
        obstacles=np.array([s.obstacle_cells for s in drawn]),
        start_heading=np.array([s.start_heading for s in drawn], np.uint8),
        goal=np.array([s.goal for s in drawn], np.uint8),
        actions=np.array([planner.labels(s.path) for s in drawn]),
        detour=np.array([s.detour for s in drawn]),
        obstacle_cell=np.full((count, 3), -1, np.int8),
        obstacle_shape=np.full((count, 3), -1, np.int8),
        obstacle_colour=np.full((count, 3), -1, np.int8),
        obstacle_position=np.zeros((count, 3, 2)),
        obstacle_yaw=np.zeros((count, 3)),
        meta={"split": "train", "count": count, "seed": seed},
    )


def perfect_eyes(world: Dataset) -> np.ndarray:
    """bool[N, 25, 25]: where one who looks around from a cell sees an obstacle, nothing being before it."""
    walls = WALLS[world.layout]
    seen = np.zeros((*walls.shape, CELLS), bool)
    for env, cell in np.argwhere(~walls & ~world.obstacles).tolist():
        for heading in range(4):
            obstacles = (there for there in line(walls[env], cell, heading) if world.obstacles[env, there])
            if (nearest := next(obstacles, None)) is not None:
                seen[env, cell, nearest] = True
    return seen


class Killed(Exception):
    pass


def silent(done, total, point):
    pass


def killed_after_first(done, total, point):
    raise Killed


def untimed(curve):
    return [{name: value for name, value in point.items() if "seconds" not in name} for point in curve]


def assert_same(one, other):
    leaves, others = jax.tree.leaves(one), jax.tree.leaves(other)
    assert len(leaves) == len(others)
    for leaf, twin in zip(leaves, others, strict=True):
        np.testing.assert_array_equal(np.asarray(leaf), np.asarray(twin))


@pytest.fixture(scope="session")
def world() -> Dataset:
    return make(60, seed=0)
