"""`ObstacleWorld`: the robot's task as a gymnasium environment.

The robot starts in the north-west corner of a 5 x 5 maze whose map it knows but for the one to
three obstacles that stand in it. Four fixed cameras and its own see them. It has 17 actions to
reach the goal and say so.
"""

import time
from typing import Any, Literal

import gymnasium
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from ciphernav_jax.world.grid import ACTIONS, CELLS, MAX_ACTIONS, START, STOP, WALL, WALLS, map_code, move
from ciphernav_jax.world.poses import CAMERAS, IMAGE_SHAPE, VIEWS, agent_pose
from ciphernav_jax.world.renderer import renderer
from ciphernav_jax.world.scenario import START_HEADINGS, Scenario, check, draw
from ciphernav_jax.world.topview import draw as draw_topview
from ciphernav_jax.world.window import Window

Observation = dict[str, Any]


class ObstacleWorld(gymnasium.Env[Observation, np.int64]):
    """Navigation among obstacles that the map does not show.

    Observation, a dict of uint8 arrays:
        bottom_left, bottom_right, top_left, top_right: [45, 60, 3], the fixed cameras.
        agent: [45, 60, 3], from the agent's cell in the direction of its last move (before the
            first, its start heading).
        map: [25], 0 free, 1 agent, 2 goal, 4 wall; see `grid.map_code`.

    Actions: 0 stop, 1 up, 2 down, 3 left, 4 right.

    Episode: the first invalid move, into a wall or an obstacle or off the grid, ends it; so does
    stop. It is cut off after 17 actions. It succeeds when stop is said on the goal cell. The
    paper's release leaves a crashed agent where it is and goes on; this is stricter.

    Reward: 1 for success, otherwise 0, so that the return is the paper's accuracy.

    Info: `outcome` ("running", "success", "crash_obstacle", "crash_wall", or "no_crash" for every
    other failure), `cell`, `heading`, `actions` taken so far, `shortest` (the number of actions of
    the shortest episode, its stop included), `detour`, and `efficient` (a success that took no
    more than `shortest`).

    Args:
        render_mode: "rgb_array", a view from above with path and cameras, uint8[480, 480, 3];
            "human" shows it in a window.
        start: "random" for a start heading east or south, "deterministic" for east, with the
            top lane in view.
        layout: 0..11 fixes the layout, see `grid.LAYOUTS`; of several, such as (8, 9), one is drawn
            for each episode, by their probabilities.
        obstacles: how many, 0..13, or their cells; shapes and places stay random. The paper's
            world has 1 to 3, drawn by their probabilities. Whatever stands there, two cells or
            more can be reached, and the goal is one of those.
        detour: fixes whether the obstacles change the shortest path; natural by default.

    `reset(options=...)` takes `start`, `layout`, `obstacles` and `detour` for one episode, or a
    whole `scenario` (`Scenario`, say from `Dataset.scenario`).

    Raises:
        GLUnavailable: on import of this module or on the first view, when OpenGL is missing.
        ValueError: for an option that is unknown or out of range; or on `reset`, when no such
            world turns up.

    Example:
        >>> world = ObstacleWorld(layout=(8, 9), obstacles=5)
        >>> observation, info = world.reset(seed=0)
        >>> world.scenario.layout in (8, 9), len(world.scenario.obstacles)
        (True, 5)
    """

    metadata = {"render_modes": ["human", "rgb_array"], "render_fps": 4}  # noqa: RUF012 - gymnasium's form

    def __init__(
        self,
        render_mode: Literal["human", "rgb_array"] | None = None,
        *,
        start: Literal["random", "deterministic"] = "random",
        layout: int | tuple[int, ...] | None = None,
        obstacles: int | tuple[int, ...] | None = None,
        detour: bool | None = None,
    ):
        if render_mode is not None and render_mode not in self.metadata["render_modes"]:
            raise ValueError(f"render_mode={render_mode!r} is not one of {self.metadata['render_modes']}.")
        observed: dict[str, spaces.Space] = {
            name: spaces.Box(0, 255, IMAGE_SHAPE, np.uint8) for name in VIEWS
        }
        observed["map"] = spaces.Box(0, WALL, (CELLS,), np.uint8)
        self.observation_space = spaces.Dict(observed)
        self.action_space = spaces.Discrete(len(ACTIONS))
        self.render_mode = render_mode
        self.scenario: Scenario
        self._options = {"start": start, "layout": layout, "obstacles": obstacles, "detour": detour}
        check(layout, _heading(start), obstacles)
        self._window: Window | None = None

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        super().reset(seed=seed)
        self.scenario = self._draw(**(options or {}))
        self._path = [START]
        self._heading = self.scenario.start_heading
        self._actions = 0
        self._outcome = "running"
        self._camera_views = renderer().render(
            self.scenario.layout, self.scenario.obstacles, range(len(CAMERAS))
        )
        if self.render_mode == "human":
            self.render()
        return self._observe(), self._info()

    def step(self, action: np.int64) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        if self._outcome != "running":
            raise gymnasium.error.ResetNeeded(f"The episode is over ({self._outcome}); call reset().")
        self._actions += 1
        cell = self._path[-1]
        if action == STOP:
            self._outcome = "success" if cell == self.scenario.goal else "no_crash"
        else:
            self._heading = int(action) - 1
            following = int(move(cell, action))
            if following < 0 or self.scenario.walls[following]:
                self._outcome = "crash_wall"
            elif self.scenario.obstacle_cells[following]:
                self._outcome = "crash_obstacle"
            else:
                self._path.append(following)
        terminated = self._outcome != "running"
        truncated = not terminated and self._actions == MAX_ACTIONS
        if truncated:
            self._outcome = "no_crash"
        if self.render_mode == "human":
            self.render()
        return self._observe(), float(self._outcome == "success"), terminated, truncated, self._info()

    def render(self) -> NDArray[np.uint8] | None:
        if self.render_mode is None:
            gymnasium.logger.warn('Nothing is rendered; make the environment with render_mode="rgb_array".')
            return None
        crashed = self._outcome.startswith("crash")
        picture = draw_topview(self.scenario, self._path, heading=self._heading, crashed=crashed)
        if self.render_mode == "rgb_array":
            return picture
        if self._window is None:
            self._window = Window(picture.shape[1], picture.shape[0], "Obstacle World")
        self._window.show(picture)
        time.sleep(1 / self.metadata["render_fps"])
        return None

    def close(self) -> None:
        if self._window is not None:
            self._window.close()
            self._window = None

    def _draw(self, scenario: Scenario | None = None, **options: Any) -> Scenario:
        if unknown := options.keys() - self._options.keys():
            raise ValueError(
                f"Unknown reset options {sorted(unknown)}; there are scenario, {', '.join(self._options)}."
            )
        if scenario is not None:
            if options:
                raise ValueError(f"A whole scenario leaves nothing to {', '.join(options)}.")
            return scenario
        options = self._options | options
        return draw(self.np_random, start_heading=_heading(options.pop("start")), **options)

    def _observe(self) -> Observation:
        world, cell = self.scenario, self._path[-1]
        agent_view = renderer().render(world.layout, world.obstacles, [agent_pose(cell, self._heading)])
        views = dict(zip(VIEWS, [*self._camera_views.copy(), *agent_view], strict=True))
        return views | {"map": map_code(WALLS[world.layout], cell, world.goal)}

    def _info(self) -> dict[str, Any]:
        shortest = len(self.scenario.path) + 1
        return {
            "outcome": self._outcome,
            "cell": self._path[-1],
            "heading": self._heading,
            "actions": self._actions,
            "shortest": shortest,
            "detour": self.scenario.detour,
            "efficient": self._outcome == "success" and self._actions <= shortest,
        }


def _heading(start: str) -> int | None:
    """The start heading that is fixed, if one is."""
    if start not in ("random", "deterministic"):
        raise ValueError(f'start={start!r} is neither "random" nor "deterministic".')
    return START_HEADINGS[0] if start == "deterministic" else None
