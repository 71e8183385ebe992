"""Which obstacles a view may contain, so that views without any are rendered once per layout.

Walls reach above every obstacle and above the eye, so sight is a matter of the floor plan: from
an eye, the floor that can be seen is a fan of triangles, one for each stretch of wall between
two neighbouring wall ends. An obstacle may be seen when its bounding circle touches one of them.
The answer errs on the side of "visible" by a small margin; it never misses an obstacle.
"""

from collections.abc import Sequence
from functools import cache

import numpy as np
from numpy.typing import NDArray

from ciphernav_jax.world.grid import STEP_TABLE, WALLS
from ciphernav_jax.world.poses import (
    CELL_SIZE,
    FIELD_OF_VIEW,
    FORWARD,
    GAP,
    IMAGE_SHAPE,
    POSE_CELL,
    POSE_EYE,
    POSE_HEADING,
    POSES,
    centre,
)
from ciphernav_jax.world.scenario import Obstacle

_ASPECT = IMAGE_SHAPE[1] / IMAGE_SHAPE[0]
_MARGIN = 0.02
"""Metres added to every circle and radians to either side of a view, for rounding in the renderer."""
_HALF_ANGLE = float(np.arctan(_ASPECT * np.tan(np.radians(FIELD_OF_VIEW / 2)))) + _MARGIN


def visible(layout: int, obstacles: Sequence[Obstacle]) -> NDArray[np.bool_]:
    """bool[104, len(obstacles)]: which obstacles may be seen from which pose; False inside walls."""
    if not obstacles:
        return np.zeros((POSES, 0), np.bool_)
    points = np.array([[o.x, o.z] for o in obstacles])
    reach = np.array([o.radius for o in obstacles]) + _MARGIN
    pose, triangles = _seen_floor(layout)
    near = _distance(points, triangles) <= reach  # [triangles, obstacles]
    result = np.zeros((POSES, len(obstacles)), np.bool_)
    np.logical_or.at(result, pose, near)
    return result


@cache
def _seen_floor(layout: int) -> tuple[NDArray[np.intp], NDArray[np.float64]]:
    """The floor seen from every free pose: pose int[T], triangles float64[T, 3 corners, xz]."""
    walls = _wall_lines(layout)
    fans = {p: _fan(p, walls) for p in range(POSES) if not WALLS[layout, POSE_CELL[p]]}
    pose = np.repeat(list(fans), [len(fan) for fan in fans.values()])
    return pose, np.concatenate(list(fans.values()))


def _wall_lines(layout: int) -> NDArray[np.float64]:
    """float64[S, 2 ends, xz]: the walls that bound the free floor, door posts included."""
    lines = []
    for cell in np.flatnonzero(~WALLS[layout]):
        for heading, ahead in enumerate(FORWARD):
            side = np.array([ahead[1], ahead[0]]) * CELL_SIZE / 2
            door = centre(int(cell)) + ahead * CELL_SIZE / 2
            following = STEP_TABLE[cell, heading + 1]
            if following < 0 or WALLS[layout, following]:
                lines.append((door - side, door + side))
            else:
                lines += [(door + s, door + s + ahead * GAP) for s in (side, -side)]
    return np.array(lines)


def _fan(pose: int, walls: NDArray[np.float64]) -> NDArray[np.float64]:
    """float64[K, 3, 2]: the triangles of floor seen from a pose, each ending at one wall."""
    eye, ahead = POSE_EYE[pose], FORWARD[POSE_HEADING[pose]]
    right = np.array([-ahead[1], ahead[0]])
    # In the eye's frame: x ahead, y to the right, so that a bearing is the arc tangent of y / x.
    a, b = np.moveaxis((walls - eye) @ np.stack([ahead, right], axis=1), 1, 0)
    bearings = np.concatenate([np.arctan2(ends[:, 1], ends[:, 0]) for ends in (a, b)])
    inside = bearings[np.abs(bearings) < _HALF_ANGLE]
    edges = np.unique(np.concatenate([[-_HALF_ANGLE], inside, [_HALF_ANGLE]]))
    edges = edges[np.concatenate([[True], np.diff(edges) > 1e-9])]

    # No wall ends between two neighbouring edges: the wall met half way is met all the way.
    middle = _ray((edges[:-1] + edges[1:]) / 2)
    along = b - a
    with np.errstate(divide="ignore", invalid="ignore"):
        turn = _cross(middle[:, None], along)
        range_ = _cross(a, along) / turn
        place = _cross(a, middle[:, None]) / turn
    range_[~((range_ > 0) & (place >= 0) & (place <= 1))] = np.inf
    met = np.argmin(range_, axis=1)
    fan = np.zeros((len(met), 3, 2))
    fan[:] = eye
    for corner, bearing in ((1, edges[:-1]), (2, edges[1:])):
        ray = _ray(bearing)
        length = _cross(a[met], along[met]) / _cross(ray, along[met])
        fan[:, corner] += (ray * length[:, None]) @ np.stack([ahead, right])
    return fan


def _ray(bearing: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.stack([np.cos(bearing), np.sin(bearing)], axis=-1)


def _cross(u: NDArray[np.float64], v: NDArray[np.float64]) -> NDArray[np.float64]:
    return u[..., 0] * v[..., 1] - u[..., 1] * v[..., 0]


def _distance(points: NDArray[np.float64], triangles: NDArray[np.float64]) -> NDArray[np.float64]:
    """float64[T, N]: the distance from each of N points to each of T triangles, 0 inside."""
    start = triangles[:, None]  # [T, 1, 3, 2]
    along = np.roll(start, -1, axis=2) - start
    offset = points[:, None] - start  # [T, N, 3, 2]
    share = np.clip((offset * along).sum(-1) / np.maximum((along**2).sum(-1), 1e-12), 0, 1)
    to_edges = np.linalg.norm(offset - share[..., None] * along, axis=-1).min(-1)
    turns = _cross(along, offset)
    return np.where((turns >= 0).all(-1) | (turns <= 0).all(-1), 0.0, to_edges)
