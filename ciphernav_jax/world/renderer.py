"""Views of Obstacle World, drawn by MiniWorld.

The rooms of all 12 layouts are compiled once, and a layout is shown by moving it into the scene
like any other entity; nothing is reset between views. A view depends on nothing but the
arguments of `render`. One process owns one renderer; OpenGL does not survive a fork.
"""

import contextlib
import io
import os
from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ciphernav_jax.world import gl
from ciphernav_jax.world.grid import CELLS, STEP_TABLE, WALLS
from ciphernav_jax.world.poses import CELL_SIZE, IMAGE_SHAPE, POSE_EYE, POSE_HEADING, YAW, centre
from ciphernav_jax.world.scenario import COLOURS, HEIGHTS, SHAPES, Obstacle

with gl.required():
    import pyglet.gl as opengl
    from miniworld.entity import Ball, Box, Entity, MeshEnt
    from miniworld.miniworld import MiniWorldEnv, Room
    from miniworld.params import DEFAULT_PARAMS

_OPENED_IN = os.getpid()  # by the imports above

_PARAMS = DEFAULT_PARAMS.copy()
_PARAMS.set("sky_color", [0.0, 0.0, 0.0])


class _Layout(Entity):
    """The rooms of one layout as an entity: drawing it replays their display list."""

    def __init__(self, rooms: list[Room]):
        super().__init__()
        self.display_list = opengl.glGenLists(1)
        opengl.glNewList(self.display_list, opengl.GL_COMPILE)
        for room in rooms:
            room._render()
        opengl.glEndList()

    def render(self):
        opengl.glCallList(self.display_list)


class _Scene(MiniWorldEnv):
    """MiniWorld's scene with the rooms of every layout ready to be shown."""

    def __init__(self):
        height, width, _ = IMAGE_SHAPE
        super().__init__(obs_width=width, obs_height=height, window_width=1, window_height=1, params=_PARAMS)

    def _gen_world(self):
        self.rooms_of = [self._build(walls) for walls in WALLS]
        self.place_agent(pos=np.zeros(3), dir=0.0)

    def _build(self, walls: NDArray[np.bool_]) -> list[Room]:
        """The layout's rooms: one for each cell, closed unless free, and the doors between."""
        self.rooms = []
        half = CELL_SIZE / 2
        cells = []
        for x, z in map(centre, range(CELLS)):
            box = {"min_x": x - half, "max_x": x + half, "min_z": z - half, "max_z": z + half}
            cells.append(self.add_rect_room(**box, wall_tex="brick_wall", floor_tex="asphalt"))
        for cell, room in enumerate(cells):
            down, right = STEP_TABLE[cell, 2], STEP_TABLE[cell, 4]
            if right >= 0 and not walls[[cell, right]].any():
                self.connect_rooms(room, cells[right], min_z=room.min_z, max_z=room.max_z)
            if down >= 0 and not walls[[cell, down]].any():
                self.connect_rooms(room, cells[down], min_x=room.min_x, max_x=room.max_x)
        for room in self.rooms:
            room._gen_static_data(self.params, None)
        return self.rooms

    def _render_static(self):
        """MiniWorld's display list keeps the lights alone; every layout has a list of its own."""
        rooms, self.rooms = self.rooms, []
        super()._render_static()
        self.rooms = rooms
        self.layouts = [_Layout(rooms) for rooms in self.rooms_of]


class Renderer:
    """Draws views. Use `renderer()`, which makes one per process."""

    def __init__(self):
        with gl.required(), contextlib.redirect_stdout(io.StringIO()):  # MiniWorld prints its fallbacks
            self._scene = _Scene()
            self.gl: str = f"{opengl.gl_info.get_renderer()}, OpenGL {opengl.gl_info.get_version()}"

    def render(self, layout: int, obstacles: Sequence[Obstacle], poses: Sequence[int]) -> NDArray[np.uint8]:
        """uint8[len(poses), 45, 60, 3]: what is seen from each pose (see `poses`)."""
        scene = self._scene
        scene.entities = [scene.layouts[layout], *map(_entity, obstacles)]
        views = np.empty((len(poses), *IMAGE_SHAPE), np.uint8)
        for view, pose in zip(views, poses, strict=True):
            x, z = POSE_EYE[pose]
            _place(scene.agent, x, z, YAW[POSE_HEADING[pose]])
            view[:] = scene.render_obs()
        return views


def renderer() -> Renderer:
    """This process's renderer, made on first use.

    Raises:
        GLUnavailable: with the packages to install; or this process was forked from one that had opened
            OpenGL, where it would wait for ever.
    """
    if os.getpid() != _OPENED_IN:
        raise gl.GLUnavailable(
            "OpenGL does not survive a fork, and was opened before this process was forked. Start processes "
            'afresh, gymnasium.make_vec(..., vector_kwargs={"context": "spawn"}), or use one: '
            'vectorization_mode="sync".'
        )
    return _renderer()


@cache
def _renderer() -> Renderer:
    return Renderer()


def _entity(obstacle: Obstacle) -> Entity:
    height, colour = HEIGHTS[obstacle.shape], COLOURS[obstacle.colour]
    match SHAPES[obstacle.shape]:
        case "box":
            entity = Box(colour, size=height)
        case "ball":
            entity = Ball(colour, size=height)
        case _:
            entity = MeshEnt("cone", height=height, static=False)
    entity.randomize(_PARAMS, None)
    _place(entity, obstacle.x, obstacle.z, obstacle.yaw)
    return entity


def _place(entity: Any, x: float, z: float, yaw: float) -> None:  # Any: MiniWorld declares `pos = None`
    entity.pos = np.array([x, 0.0, z])
    entity.dir = yaw
