"""Shortest paths on the grid, and whether obstacles force a detour.

The search is breadth first with neighbours in the order right, down, left, up, which settles
ties between paths of equal length; labels and the detour test depend on that order.
"""

from collections import deque

import numpy as np
from numpy.typing import NDArray

from ciphernav_jax.world.grid import DOWN, LEFT, MAX_ACTIONS, RIGHT, START, STEP_TABLE, STOP, UP

_NEXT = STEP_TABLE.tolist()
NO_LABEL = -1


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
        for action in (RIGHT, DOWN, LEFT, UP):
            following = _NEXT[cell][action]
            if following >= 0 and not barred[following] and following not in found:
                found[following] = (*found[cell], action)
                queue.append(following)
    del found[START]
    return found


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
