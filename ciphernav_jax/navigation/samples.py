"""Teacher-forced samples: where the robot stands at each step of the right path, and what it should do.

Only indices are made; pixels stay in the data set until a batch asks for them.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ciphernav_jax.navigation.methods import Method
from ciphernav_jax.world.dataset import Dataset
from ciphernav_jax.world.grid import RIGHT, START, move


@dataclass(frozen=True)
class Samples:
    """One row per step of every environment's path, stop included, by environment and then by step.

    Attributes:
        env: int64[S], the environment.
        cell: int64[S], where the robot stands, 0..24.
        heading: int64[S], where it looks, 0..3.
        action: int64[S], what it should do, 0..4.
    """

    env: NDArray[np.int64]
    cell: NDArray[np.int64]
    heading: NDArray[np.int64]
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
    return Samples(env, cells[env, step], headings[env, step], actions[env, step])
