"""The grid: 25 cells, 12 layouts of walls, moves, and the map as the model reads it.

Cells are numbered 0..24 row by row (cell = 5 * row + column), with row 0 in the north and
column 0 in the west. Actions: 0 stop, 1 up (row - 1), 2 down, 3 left, 4 right. A heading is the
direction of a move: heading = action - 1, so 0 up, 1 down, 2 left, 3 right.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

SIDE = 5
CELLS = SIDE * SIDE
START = 0
MAX_ACTIONS = 17
"""Length of the longest episode, the stop included."""

STOP, UP, DOWN, LEFT, RIGHT = range(5)
ACTIONS = ("stop", "up", "down", "left", "right")
HEADINGS = ACTIONS[1:]

FREE, AGENT, GOAL, WALL = 0, 1, 2, 4  # 3, an obstacle, exists in no map that a model may see

_PICTURES = """
.....  .....  .....  .....
.###.  .###.  .###.  .###.
..##.  ...#.  .#...  .##..
.###.  .###.  .###.  .###.
.....  .....  .....  .....

.....  .....  .....  .....
.#.#.  .#.#.  .###.  .###.
.###.  .#.#.  .#.#.  .###.
.###.  .###.  .#.#.  .#.#.
.....  .....  .....  .....

.....  .....  .....  .....
.###.  .#.#.  .#.#.  .###.
.....  .#.#.  .....  .###.
.###.  .#.#.  .#.#.  .###.
.....  .....  .....  .....
"""

LAYOUTS: tuple[str, ...] = tuple(
    "\n".join(rows)
    for band in _PICTURES.strip().split("\n\n")
    for rows in zip(*map(str.split, band.split("\n")), strict=True)
)
"""The 12 layouts as pictures, `#` a wall and `.` a free cell. The border is always free."""

WALLS: NDArray[np.bool_] = np.array([[c == "#" for c in p.replace("\n", "")] for p in LAYOUTS])
"""bool[12, 25]: which cells of a layout are walls."""

LAYOUT_PROBABILITIES: NDArray[np.float64] = np.array([0.05] * 8 + [0.15] * 4)
"""float64[12]: how often a layout is drawn."""

_ROW, _COLUMN = np.divmod(np.arange(CELLS), SIDE)
BORDER: tuple[int, ...] = tuple(np.flatnonzero((_ROW % 4 == 0) | (_COLUMN % 4 == 0)).tolist())
"""The 16 cells of the outer ring, the start among them."""


def _step_table() -> NDArray[np.int8]:
    rows = _ROW[:, None] + np.array([0, -1, 1, 0, 0])
    columns = _COLUMN[:, None] + np.array([0, 0, 0, -1, 1])
    inside = (rows >= 0) & (rows < SIDE) & (columns >= 0) & (columns < SIDE)
    return np.where(inside, SIDE * rows + columns, -1).astype(np.int8)


STEP_TABLE: NDArray[np.int8] = _step_table()
"""int8[25, 5]: the cell that an action leads to, -1 off the grid; walls and obstacles do not count."""


def move(cell: ArrayLike, action: ArrayLike) -> NDArray[np.int8]:
    """The cell that `action` leads to from `cell`, or -1 off the grid; both may be arrays."""
    return STEP_TABLE[np.asarray(cell), np.asarray(action)]


def _rays() -> NDArray[np.int8]:
    cells = [np.repeat(np.arange(CELLS)[:, None], 4, axis=1)]
    while len(cells) < SIDE:
        following = STEP_TABLE[cells[-1], np.arange(1, 5)]
        cells.append(np.where(cells[-1] < 0, -1, following))
    return np.stack(cells[1:], axis=2).astype(np.int8)


RAYS: NDArray[np.int8] = _rays()
"""int8[25, 4, 4]: the cells straight ahead of a cell and heading, nearest first, -1 off the grid."""


def map_code(walls: ArrayLike, agent: ArrayLike, goal: ArrayLike) -> NDArray[np.uint8]:
    """The map as the map encoder reads it: 0 free, 1 agent, 2 goal, 4 wall.

    An agent that stands on the goal reads 1: the map without a goal says that it has arrived.

    Args:
        walls: bool[..., 25].
        agent: the agent's cell, int[...].
        goal: the goal's cell, int[...].

    Returns:
        uint8[..., 25] of the broadcast shape.
    """
    cells = np.arange(CELLS)
    at_agent = np.asarray(agent)[..., None] == cells
    at_goal = np.asarray(goal)[..., None] == cells
    free_or_wall = np.where(walls, WALL, FREE)
    return np.where(at_agent, AGENT, np.where(at_goal, GOAL, free_or_wall)).astype(np.uint8)
