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
from ciphernav_jax.world.grid import CELLS, HEADINGS, MAX_ACTIONS, START, STOP, WALLS, move

Policy = Callable[[int, NDArray[np.int64], NDArray[np.int64]], NDArray[np.int64]]
"""Actions int64[N] from the question's number and every robot's cell and heading, int64[N].

A secret policy takes its randomness by that number, so no two questions of an episode may have the same.
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
    """

    actions: NDArray[np.int64]
    cells: NDArray[np.int64]
    outcome: NDArray[np.int64]

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


def careful(policy: Policy, dataset: Dataset) -> Policy:
    """A robot that uses what it alone knows: the map, its place, its goal, and where it has been.

    On its goal it stops, without asking. Elsewhere an answer makes no sense to it when it would stop, or run
    into a wall of its map, or when it has asked in this cell with this view before, and so would go in
    circles. Then it turns and asks again with another view, up to all four; if none helps, it follows the
    first. Nothing more is opened for that than the answers, and turning is no action: it does not move.
    """
    walls, goal = WALLS[dataset.layout], np.asarray(dataset.goal)
    every = np.arange(len(goal))
    asked = np.zeros((len(goal), CELLS, len(HEADINGS)), bool)

    def decide(step: int, cells: NDArray[np.int64], headings: NDArray[np.int64]) -> NDArray[np.int64]:
        if step == 0:
            asked[:] = False
        chosen = np.where(cells == goal, STOP, -1)
        for turn in range(len(HEADINGS)):
            looking = (headings + turn) % len(HEADINGS)
            answers = policy(len(HEADINGS) * step + turn, cells, looking)
            following = move(cells, answers).astype(np.int64)
            senseless = (
                (answers == STOP) | (following < 0) | walls[every, following] | asked[every, cells, looking]
            )
            pending = chosen < 0
            asked[every[pending], cells[pending], looking[pending]] = True
            chosen = np.where(pending & ~senseless, answers, chosen)
            if turn == 0:
                first = answers
            if (chosen >= 0).all():
                break
        return np.where(chosen < 0, first, chosen)

    return decide


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
