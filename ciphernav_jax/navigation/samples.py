"""Training samples: where the robot stands, where it wants to go, and what it should do.

The paper's are teacher-forced, on the right paths of the data set. More can be made in the same environments:
a robot that knows where the obstacles are may set out for other goals, and stray from its path.

Only indices are made; pixels stay in the data set until a batch asks for them.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ciphernav_jax.navigation.methods import Method
from ciphernav_jax.world.dataset import Dataset
from ciphernav_jax.world.grid import MAX_ACTIONS, RIGHT, START, STEP_TABLE, STOP, WALLS, move
from ciphernav_jax.world.planner import guide


@dataclass(frozen=True)
class Samples:
    """One row per step of every path, stop included, by environment.

    Attributes:
        env: int64[S], the environment.
        cell: int64[S], where the robot stands, 0..24.
        heading: int64[S], where it looks, 0..3.
        goal: int64[S], where it wants to go, 0..24.
        action: int64[S], what it should do, 0..4.
    """

    env: NDArray[np.int64]
    cell: NDArray[np.int64]
    heading: NDArray[np.int64]
    goal: NDArray[np.int64]
    action: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.env)


def start_headings(dataset: Dataset, method: Method) -> NDArray[np.int64]:
    """int64[N]: where the robot looks before its first move; right, if the method fixes its start."""
    if method.fixed_start:
        return np.full(len(dataset), RIGHT - 1)
    return np.asarray(dataset.start_heading, np.int64)


def teacher_forced(dataset: Dataset, method: Method) -> Samples:
    """The samples of a data set. The label moves the robot, whatever a model would have predicted."""
    actions = np.asarray(dataset.actions, np.int64)
    count, steps = actions.shape
    cells = np.full((count, steps), START)
    headings = np.repeat(start_headings(dataset, method)[:, None], steps, axis=1)
    for step in range(1, steps):
        last = np.maximum(actions[:, step - 1], 0)  # nothing moves after the stop
        cells[:, step] = move(cells[:, step - 1], last)
        headings[:, step] = np.where(last > 0, last - 1, headings[:, step - 1])
    env, step = np.nonzero(actions >= 0)
    goal = np.asarray(dataset.goal, np.int64)
    return Samples(env, cells[env, step], headings[env, step], goal[env], actions[env, step])


def errands(dataset: Dataset, method: Method, seed: int, count: int, stray: float) -> Samples:
    """Samples of `count` more paths in every environment, each from the start to a goal of its own.

    Goals are uniform among the cells that can be reached. At each step the robot takes, with probability
    `stray`, any valid move instead of the right one, so that it also sees what is beside the path; it is told
    the right action all the same, and gives up after 17.
    """
    rng = np.random.default_rng([seed, count])
    blocked = WALLS[dataset.layout] | np.asarray(dataset.obstacles)
    environments = np.arange(len(dataset))
    homeward = guide(blocked, np.full(len(dataset), START))
    parts = []
    for _ in range(count):
        goal = _one_of(rng, homeward > STOP)
        right = guide(blocked, goal)
        cell, heading = np.full(len(dataset), START), start_headings(dataset, method).copy()
        running = np.ones(len(dataset), bool)
        for _ in range(MAX_ACTIONS):
            action = right[environments, cell].astype(np.int64)
            parts.append(np.stack([environments, cell, heading, goal, action])[:, running])
            around = STEP_TABLE[cell].astype(np.int64)
            valid = (around >= 0) & ~blocked[environments[:, None], around]
            valid[:, STOP] = False
            taken = np.where(rng.random(len(dataset)) < stray, _one_of(rng, valid), action)
            running &= taken != STOP
            cell = np.where(running, around[environments, taken], cell)
            heading = np.where(running, taken - 1, heading)
    rows = np.concatenate(parts, axis=1)
    return Samples(*rows[:, np.argsort(rows[0], kind="stable")])


def training_samples(dataset: Dataset, method: Method, seed: int, count: int, stray: float) -> Samples:
    """The teacher-forced samples and, for a `count` above 0, those of `errands`, by environment."""
    forced = teacher_forced(dataset, method)
    if not count:
        return forced
    more = errands(dataset, method, seed, count, stray)
    rows = [np.concatenate(pair) for pair in zip(vars(forced).values(), vars(more).values(), strict=True)]
    order = np.argsort(rows[0], kind="stable")
    return Samples(*(row[order] for row in rows))


def _one_of(rng: np.random.Generator, allowed: NDArray[np.bool_]) -> NDArray[np.int64]:
    """For each row one of its true columns, uniformly."""
    return np.argmax(np.where(allowed, rng.random(allowed.shape), -1.0), axis=1)
