"""A picture of an episode from above: walls, obstacles, goal, cameras and the path taken.

It is drawn in two dimensions and needs no OpenGL.
"""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from ciphernav_jax.world.grid import CELLS, START, STEP_TABLE
from ciphernav_jax.world.poses import (
    CAMERAS,
    CELL_SIZE,
    EXTENT,
    FIELD_OF_VIEW,
    FORWARD,
    IMAGE_SHAPE,
    PITCH,
    POSE_EYE,
    POSE_HEADING,
    centre,
)
from ciphernav_jax.world.scenario import COLOURS, SHAPES, Obstacle, Scenario

_WALL, _FLOOR, _GOAL = (110, 66, 56), (214, 212, 208), (170, 222, 160)
_PATH, _AGENT, _CRASH, _CAMERA = (40, 90, 200), (20, 50, 140), (215, 30, 30), (30, 30, 30)
_SIGHT = (250, 205, 90)
_RGB = {
    "green": (0, 190, 0),
    "blue": (0, 0, 230),
    "purple": (112, 38, 191),
    "yellow": (245, 225, 0),
    "grey": (100, 100, 100),
}
_CONE = (240, 130, 30)
_SPREAD = math.tan(math.radians(FIELD_OF_VIEW / 2)) * IMAGE_SHAPE[1] / IMAGE_SHAPE[0]
_SMOOTH = 3  # drawn this much larger, then reduced
_MARGIN = 0.25  # metres of wall around the world


def draw(
    scenario: Scenario,
    path: Sequence[int] = (START,),
    *,
    heading: int | None = None,
    crashed: bool = False,
    size: int = 480,
) -> NDArray[np.uint8]:
    """Draws a scenario and an episode in it, north up.

    Args:
        scenario: the environment.
        path: the cells that the agent was in, in order; it stands in the last one.
        heading: where it looks, 0 up, 1 down, 2 left, 3 right; by default the start heading, or
            the direction of the last step.
        crashed: whether its last action, in the direction of `heading`, was an invalid move.
        size: width and height in pixels.

    Returns:
        uint8[size, size, 3].
    """
    canvas = _Canvas(size)
    for cell in np.flatnonzero(~scenario.walls).tolist():
        canvas.rectangle(centre(cell), CELL_SIZE / 2, _GOAL if cell == scenario.goal else _FLOOR)
    _draw_doors(canvas, scenario)
    for pose in range(len(CAMERAS)):
        _draw_camera(canvas, POSE_EYE[pose], FORWARD[POSE_HEADING[pose]])
    for obstacle in scenario.obstacles:
        _draw_obstacle(canvas, obstacle)
    stops = [centre(cell) for cell in path]
    canvas.line(stops, 0.12, _PATH)
    if heading is None:
        heading = _last_heading(scenario, path)
    ahead = FORWARD[heading]
    if crashed:
        _draw_cross(canvas, stops[-1] + ahead * PITCH / 2)
    back, side = stops[-1] - 0.35 * ahead, 0.32 * ahead[::-1]
    canvas.polygon([stops[-1] + 0.5 * ahead, back + side, back - side], _AGENT)
    return canvas.pixels()


def pixel(place: NDArray[np.float64], size: int = 480) -> NDArray[np.float64]:
    """Where a place of the world, x (east) and z (south) in metres, stands in a picture of this size."""
    return (place + _MARGIN) * _scale(size)


def _scale(size: int) -> float:
    """Pixels of a metre."""
    return size / (EXTENT + 2 * _MARGIN)


class _Canvas:
    """Shapes in the world's metres."""

    def __init__(self, size: int):
        self._size = size
        self._large = size * _SMOOTH
        self._image = Image.new("RGB", (self._large, self._large), _WALL)
        self._draw = ImageDraw.Draw(self._image)

    def _pixels(self, points) -> list[tuple[float, float]]:
        return [tuple(pixel(np.asarray(point), self._large)) for point in points]

    def polygon(self, points, colour) -> None:
        self._draw.polygon(self._pixels(points), fill=colour)

    def rectangle(self, middle, half, colour) -> None:
        self._draw.rectangle(sum(self._pixels([middle - half, middle + half]), ()), fill=colour)

    def circle(self, middle, radius, colour) -> None:
        self._draw.ellipse(sum(self._pixels([middle - radius, middle + radius]), ()), fill=colour)

    def line(self, points, width, colour) -> None:
        self._draw.line(
            self._pixels(points), fill=colour, width=round(width * _scale(self._large)), joint="curve"
        )

    def pixels(self) -> NDArray[np.uint8]:
        return np.asarray(self._image.resize((self._size, self._size), Image.Resampling.BOX)).copy()


def _draw_doors(canvas: _Canvas, scenario: Scenario) -> None:
    for cell in range(CELLS):
        for heading in (1, 3):
            following = int(STEP_TABLE[cell, heading + 1])
            if following >= 0 and not scenario.walls[[cell, following]].any():
                half = (
                    np.abs(FORWARD[heading]) * (PITCH - CELL_SIZE) / 2
                    + np.abs(FORWARD[heading][::-1]) * CELL_SIZE / 2
                )
                canvas.rectangle((centre(cell) + centre(following)) / 2, half, _FLOOR)


def _draw_camera(canvas: _Canvas, eye: NDArray[np.float64], ahead: NDArray[np.float64]) -> None:
    side = ahead[::-1] * _SPREAD
    canvas.polygon([eye, eye + 0.8 * (ahead + side), eye + 0.8 * (ahead - side)], _SIGHT)
    canvas.circle(eye, 0.15, _CAMERA)


def _draw_obstacle(canvas: _Canvas, obstacle: Obstacle) -> None:
    middle = np.array([obstacle.x, obstacle.z])
    colour = _RGB[COLOURS[obstacle.colour]]
    match SHAPES[obstacle.shape]:
        case "box":
            turns = obstacle.yaw + np.pi / 4 + np.arange(4) * np.pi / 2
            corners = middle + math.sqrt(0.5) * np.stack([np.cos(turns), -np.sin(turns)], axis=1)
            canvas.polygon(list(corners), colour)
        case "ball":
            canvas.circle(middle, 0.5, colour)
        case _:
            canvas.circle(middle, 0.4, _CONE)
            canvas.circle(middle, 0.2, (255, 255, 255))


def _draw_cross(canvas: _Canvas, middle: NDArray[np.float64]) -> None:
    for slope in (1, -1):
        arm = 0.3 * np.array([1, slope])
        canvas.line([middle - arm, middle + arm], 0.14, _CRASH)


def _last_heading(scenario: Scenario, path: Sequence[int]) -> int:
    if len(path) < 2:
        return scenario.start_heading
    return STEP_TABLE[path[-2], 1:].tolist().index(path[-1])
