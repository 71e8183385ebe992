"""Where the cameras stand: four fixed ones, and the agent's in every cell and heading.

Metres, x to the east and z to the south, the origin in the grid's north-west corner. A cell is
a room of side 2 and rooms are 0.25 apart. All poses are numbered in one row:

- 0..3: the fixed cameras bottom_left, bottom_right, top_left, top_right;
- 4 + 4 * cell + heading: the agent in the middle of a cell.
"""

import math

import numpy as np
from numpy.typing import NDArray

from ciphernav_jax.world.grid import CELLS, HEADINGS, RAYS, SIDE

CELL_SIZE = 2.0
GAP = 0.25
PITCH = CELL_SIZE + GAP
EXTENT = SIDE * PITCH - GAP
"""Side of the whole world in metres."""

IMAGE_SHAPE = (45, 60, 3)
"""Height, width and channels of every view."""
EYE_HEIGHT = 1.5
FIELD_OF_VIEW = 60.0
"""Vertical, in degrees."""

CAMERAS = ("bottom_left", "bottom_right", "top_left", "top_right")
VIEWS = (*CAMERAS, "agent")
"""The five views in the order in which their features enter the classifier."""

YAW = (math.pi / 2, -math.pi / 2, math.pi, 0.0)
"""MiniWorld's direction of each heading: up, down, left, right."""
FORWARD: NDArray[np.float64] = np.array([[0.0, -1.0], [0.0, 1.0], [-1.0, 0.0], [1.0, 0.0]])
"""float64[4, 2]: the unit vector (x, z) of each heading."""


def centre(cell: int) -> NDArray[np.float64]:
    """float64[2]: x and z of the middle of a cell."""
    row, column = divmod(cell, SIDE)
    return CELL_SIZE / 2 + PITCH * np.array([column, row], np.float64)


def agent_pose(cell: int, heading: int) -> int:
    """The number of the agent's pose."""
    return len(CAMERAS) + len(HEADINGS) * cell + heading


_CAMERA_EYES = [(0.5, 10.5), (10.5, 10.5), (0.5, 0.5), (10.5, 0.5)]
_CAMERA_HEADINGS = [0, 2, 3, 1]  # each looks along the lane named after it: left, bottom, top, right

POSE_EYE: NDArray[np.float64] = np.array(
    _CAMERA_EYES + [tuple(centre(cell)) for cell in range(CELLS) for _ in HEADINGS]
)
"""float64[104, 2]: x and z of every pose's eye."""
POSE_HEADING: NDArray[np.intp] = np.array(_CAMERA_HEADINGS + list(range(len(HEADINGS))) * CELLS)
"""int[104]: the heading of every pose."""
POSE_CELL: NDArray[np.intp] = np.array([20, 24, 0, 4] + [c for c in range(CELLS) for _ in HEADINGS])
"""int[104]: the cell in which every pose's eye stands."""
POSES = len(POSE_HEADING)


_FIXED = POSE_CELL[: len(CAMERAS)]
LANES: NDArray[np.intp] = np.c_[_FIXED, RAYS[_FIXED, POSE_HEADING[: len(CAMERAS)]]].astype(np.intp)
"""int[4, 5]: the cells of the lane that each fixed camera looks along, from its own cell to the far end."""
