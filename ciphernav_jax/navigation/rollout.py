"""Closed-loop episodes in all environments of a data set at once.

The rule: an episode has at most 17 actions, the stop included. It succeeds when the robot stops on
its goal. The first invalid move ends it as a crash, with a wall (or the edge of the grid) or with
an obstacle; whatever else fails is no crash. The authors' release is milder: there a robot that has
crashed stays where it is and goes on.
"""

from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from ciphernav_jax.world.dataset import Dataset
from ciphernav_jax.world.grid import MAX_ACTIONS, START, STOP, WALLS, move
from ciphernav_jax.world.planner import distances, guide

Policy = Callable[[int, NDArray[np.int64], NDArray[np.int64]], NDArray[np.int64]]
"""Actions int64[N] from the number of the step and every robot's cell and heading, int64[N].

A secret policy takes its randomness by that number, so it is asked once for each step of an episode.
"""


class Outcome(IntEnum):
    """How an episode ended."""

    SUCCESS = 0
    CRASH_OBSTACLE = 1
    CRASH_WALL = 2
    NO_CRASH = 3


@dataclass(frozen=True)
class Episodes:
    """What happened in N episodes.

    Attributes:
        actions: int64[N, 17], the actions taken, a crash's and the stop among them; -1 afterwards.
        cells: int64[N, 18], where the robot stood before each action and at the end; -1 afterwards.
        outcome: int64[N], an `Outcome`.
        alone: bool[N], which robots came to plan for themselves (`Careful`); None where none could.
    """

    actions: NDArray[np.int64]
    cells: NDArray[np.int64]
    outcome: NDArray[np.int64]
    alone: NDArray[np.bool_] | None = None

    @property
    def lengths(self) -> NDArray[np.int64]:
        """int64[N]: the number of actions taken."""
        return (self.actions >= 0).sum(axis=1)


def rollout(dataset: Dataset, policy: Policy, headings: NDArray[np.int64]) -> Episodes:
    """Let a policy drive in every environment.

    Args:
        dataset: the environments.
        policy: asked for all robots at every step; answers for those that are done do not matter.
        headings: int64[N], where the robots look at the start.
    """
    walls, obstacles = WALLS[dataset.layout], np.asarray(dataset.obstacles)
    count = len(headings)
    every = np.arange(count)
    cell, heading = np.full(count, START), headings.copy()
    running = np.ones(count, bool)
    actions = np.full((count, MAX_ACTIONS), -1)
    cells = np.full((count, MAX_ACTIONS + 1), -1)
    cells[:, 0] = START
    outcome = np.full(count, Outcome.NO_CRASH)
    for step in range(MAX_ACTIONS):
        action = policy(step, cell, heading)
        following = move(cell, action).astype(np.int64)
        stopped = running & (action == STOP)
        off_grid = following < 0
        wall = running & (off_grid | walls[every, following])
        obstacle = running & ~wall & obstacles[every, following]
        outcome[stopped & (cell == dataset.goal)] = Outcome.SUCCESS
        outcome[wall] = Outcome.CRASH_WALL
        outcome[obstacle] = Outcome.CRASH_OBSTACLE

        actions[running, step] = action[running]
        running = running & ~(stopped | wall | obstacle)
        cell = np.where(running, following, cell)
        heading = np.where(running, action - 1, heading)
        cells[running, step + 1] = cell[running]
        if not running.any():
            break
    return Episodes(actions, cells, outcome)


class Careful:
    """A robot that uses what it alone knows: its map, place and goal, where it has been, and its own eyes.

    In every cell it looks around, which is no action, and remembers the obstacles that it sees. On its goal
    it stops, without asking. Elsewhere it asks the parties, and follows an answer that makes sense: from
    where it leads, the goal can be reached with the actions left, through cells in which it has not been and
    which are free as far as it knows. As long as the answers are right they make sense: the shortest path
    around all obstacles, seen or not, enters no cell twice. From the first that makes none on it plans for
    itself, the shortest path on its map around the obstacles that it has seen.

    Nothing more is opened for that than the answers, at most one for each action.

    Args:
        policy: the parties' answers.
        dataset: the environments; of their obstacles nothing is read.
        seen: bool[N, 25, 25], what it sees; see `sight.obstacles_in_sight`.

    Attributes:
        alone: bool[N], which robots came to plan for themselves.
    """

    def __init__(self, policy: Policy, dataset: Dataset, seen: NDArray[np.bool_]):
        self._policy, self._seen = policy, seen
        self._walls, self._goal = WALLS[dataset.layout], np.asarray(dataset.goal)
        self._every = np.arange(len(self._goal))
        self._begin()

    def _begin(self) -> None:
        self._blocked = self._walls.copy()
        self._been = np.zeros_like(self._walls)
        self.alone = np.zeros(len(self._goal), bool)

    def __call__(self, step: int, cells: NDArray[np.int64], headings: NDArray[np.int64]) -> NDArray[np.int64]:
        if step == 0:
            self._begin()
        self._blocked |= self._seen[self._every, cells]
        self._been[self._every, cells] = True
        moves_left = MAX_ACTIONS - 1 - step  # the last action is to stop
        answers = self._policy(step, cells, headings)
        arrived = cells == self._goal

        following = move(cells, answers).astype(np.int64)  # its own cell, where it has been, if told to stop
        onward = distances(self._blocked | self._been, self._goal)[self._every, following]
        sensible = (following >= 0) & (onward < moves_left)
        self.alone |= ~arrived & ~sensible

        planned = guide(self._blocked, self._goal)[self._every, cells].astype(np.int64)
        # Where nothing leads to the goal its eyes have erred; then the parties must know.
        told = ~self.alone | (planned < 0)
        return np.where(arrived, STOP, np.where(told, answers, planned))


def random_walk(dataset: Dataset, seed: int) -> Episodes:
    """The paper's baseline: uniform among the valid moves; it succeeds on entering the goal."""
    rng = np.random.default_rng(seed)
    blocked = WALLS[dataset.layout] | dataset.obstacles
    count = len(blocked)
    goal = np.asarray(dataset.goal)
    actions = np.full((count, MAX_ACTIONS), -1)
    cells = np.full((count, MAX_ACTIONS + 1), -1)
    cells[:, 0] = START
    outcome = np.full(count, Outcome.NO_CRASH)
    for env in range(count):
        for step in range(MAX_ACTIONS):
            around = move(cells[env, step], np.arange(1, 5))
            valid = [
                a for a, following in enumerate(around, 1) if following >= 0 and not blocked[env, following]
            ]
            actions[env, step] = rng.choice(valid)
            cells[env, step + 1] = move(cells[env, step], actions[env, step])
            if cells[env, step + 1] == goal[env]:
                outcome[env] = Outcome.SUCCESS
                break
    return Episodes(actions, cells, outcome)
