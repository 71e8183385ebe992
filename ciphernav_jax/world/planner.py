"""Shortest paths on the grid, from the start and from everywhere, and whether obstacles force a detour.

The search is breadth first with neighbours in the order right, down, left, up, which settles
ties between paths of equal length; labels and the detour test depend on that order.
"""

from collections import deque

import numpy as np
from numpy.typing import NDArray

from ciphernav_jax.world.grid import CELLS, DOWN, LEFT, MAX_ACTIONS, RIGHT, START, STEP_TABLE, STOP, UP

_NEXT = STEP_TABLE.tolist()
NO_LABEL = -1
ORDER = (RIGHT, DOWN, LEFT, UP)
FAR = 2 * CELLS  # farther than any path is long
_FOLLOWING = np.where(STEP_TABLE < 0, CELLS, STEP_TABLE)  # a cell off the grid, as far as can be


def paths(blocked: NDArray[np.bool_]) -> dict[int, tuple[int, ...]]:
    """The moves from the start to every cell that can be reached, by breadth-first search.

    Args:
        blocked: bool[25], the cells that cannot be entered (walls, and obstacles if they count).

    Returns:
        A dict from cell to moves (1 up, 2 down, 3 left, 4 right); the start has none and is left out.
    """
    barred = blocked.tolist()
    found: dict[int, tuple[int, ...]] = {START: ()}
    queue = deque([START])
    while queue:
        cell = queue.popleft()
        for action in ORDER:
            following = _NEXT[cell][action]
            if following >= 0 and not barred[following] and following not in found:
                found[following] = (*found[cell], action)
                queue.append(following)
    del found[START]
    return found


def guide(blocked: NDArray[np.bool_], goal: NDArray[np.integer]) -> NDArray[np.int8]:
    """The next action of the shortest path to the goal from every cell, of N worlds at once.

    From the start it leads along the path that `paths` finds.

    Args:
        blocked: bool[N, 25], the cells that cannot be entered.
        goal: int[N], free cells.

    Returns:
        int8[N, 25]: a move, 0 on the goal, -1 where blocked or cut off from the goal.
    """
    distance = np.pad(distances(blocked, goal), ((0, 0), (0, 1)), constant_values=FAR)
    actions = np.full(blocked.shape, NO_LABEL, np.int8)
    for action in reversed(ORDER):  # the first in the order is written last
        closer = distance[:, _FOLLOWING[:, action]] == distance[:, :CELLS] - 1
        actions[closer & (distance[:, :CELLS] < FAR)] = action
    actions[np.arange(len(blocked)), goal] = STOP
    return actions


def distances(blocked: NDArray[np.bool_], goal: NDArray[np.integer]) -> NDArray[np.int64]:
    """How many moves it takes to the goal from every cell, of N worlds at once.

    Args:
        blocked: bool[N, 25], the cells that cannot be entered.
        goal: int[N], free cells.

    Returns:
        int64[N, 25]: `FAR` where blocked or cut off from the goal.
    """
    every = np.arange(len(blocked))
    distance = np.full((len(blocked), CELLS + 1), FAR)
    distance[every, goal] = 0
    for _ in range(CELLS):
        nearer = np.min(distance[:, _FOLLOWING[:, 1:]], axis=2) + 1
        distance[:, :CELLS] = np.where(blocked, FAR, np.minimum(distance[:, :CELLS], nearer))
    return distance[:, :CELLS]


def needs_detour(walls: NDArray[np.bool_], obstacles: NDArray[np.bool_], goal: int) -> bool:
    """Whether the path to `goal` (reachable) with obstacles differs from the path without them.

    A reroute of equal length counts. `walls` and `obstacles` are bool[25].
    """
    return paths(walls | obstacles)[goal] != paths(walls)[goal]


def labels(moves: tuple[int, ...]) -> NDArray[np.int8]:
    """int8[17]: the moves, a final stop, and -1 after it.

    Raises:
        ValueError: when the moves and the stop do not fit into 17 actions.
    """
    if len(moves) >= MAX_ACTIONS:
        raise ValueError(f"{len(moves)} moves and a stop do not fit into {MAX_ACTIONS} actions.")
    row = np.full(MAX_ACTIONS, NO_LABEL, np.int8)
    row[: len(moves) + 1] = (*moves, STOP)
    return row
