"""A scenario: everything that one environment consists of, and how it is drawn.

Sources: Lu, Chiquier, Vondrick, "Private Multiparty Perception for Navigation" (NeurIPS 2022),
and the authors' release for the probabilities.
"""

import math
from collections.abc import Container
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ciphernav_jax.world import planner
from ciphernav_jax.world.grid import BORDER, CELLS, LAYOUT_PROBABILITIES, START, WALLS
from ciphernav_jax.world.poses import CELL_SIZE, centre

SHAPES = ("box", "ball", "cone")
SHAPE_PROBABILITIES = (0.5, 0.4, 0.1)
HEIGHTS = (1.0, 1.0, 1.2)
RADII = (math.sqrt(0.5), 0.7085392, 0.5383567)
"""MiniWorld's radius of each shape at its height: the circle that holds the whole of it."""
COLOURS = ("green", "blue", "purple", "yellow", "grey")

MAX_OBSTACLES = 3
COUNT_PROBABILITIES = (0.35, 0.35, 0.30)
MOST_OBSTACLES = 13
"""How many a scenario can have at all, when they are asked for: two cells must be left to be reached."""
START_HEADINGS = (3, 1)  # east, south
OBSTACLE_CELLS = tuple(cell for cell in BORDER if cell != START)
_MAX_DRAWS = 20_000


@dataclass(frozen=True)
class Obstacle:
    """One obstacle: cell 0..24, shape and colour as indices into `SHAPES` and `COLOURS`, the
    centre (x east, z south) in metres, yaw in radians. A cone keeps its own texture whatever
    its colour."""

    cell: int
    shape: int
    colour: int
    x: float
    z: float
    yaw: float

    @property
    def radius(self) -> float:
        """Radius in metres of the circle on the floor that holds all of it."""
        return RADII[self.shape]


@dataclass(frozen=True)
class Scenario:
    """One environment: layout 0..11, start heading (3 east or 1 south), goal cell, obstacles."""

    layout: int
    start_heading: int
    goal: int
    obstacles: tuple[Obstacle, ...]

    @property
    def walls(self) -> NDArray[np.bool_]:
        """bool[25]: the layout's walls."""
        return WALLS[self.layout]

    @cached_property
    def obstacle_cells(self) -> NDArray[np.bool_]:
        """bool[25]: the cells that hold an obstacle."""
        return _mask([o.cell for o in self.obstacles])

    @property
    def blocked(self) -> NDArray[np.bool_]:
        """bool[25]: walls and obstacles."""
        return self.walls | self.obstacle_cells

    @cached_property
    def path(self) -> tuple[int, ...]:
        """The moves of the shortest path from start to goal."""
        return planner.paths(self.blocked)[self.goal]

    @cached_property
    def detour(self) -> bool:
        """Whether the obstacles change the path."""
        return self.path != planner.paths(self.walls)[self.goal]

    @property
    def key(self) -> tuple[int, int]:
        """Layout and obstacle cells as two integers; what an unseen test set has not in common."""
        return key(self.layout, self.obstacle_cells)


def key(layout: int, obstacle_cells: NDArray[np.bool_]) -> tuple[int, int]:
    """The layout, and bool[25] of obstacle cells as one integer with cell i as bit i."""
    return int(layout), sum(1 << int(cell) for cell in np.flatnonzero(obstacle_cells))


def draw_obstacle(rng: np.random.Generator, cell: int) -> Obstacle:
    """An obstacle of random shape, colour, place and yaw that stays inside `cell`."""
    shape = int(rng.choice(len(SHAPES), p=SHAPE_PROBABILITIES))
    colour = int(rng.integers(len(COLOURS)))
    slack = CELL_SIZE / 2 - RADII[shape]
    x, z = centre(cell) + rng.uniform(-slack, slack, size=2)
    return Obstacle(cell, shape, colour, float(x), float(z), float(rng.uniform(-math.pi, math.pi)))


def draw(
    rng: np.random.Generator,
    *,
    layout: int | tuple[int, ...] | None = None,
    start_heading: int | None = None,
    obstacles: int | tuple[int, ...] | None = None,
    detour: bool | None = None,
    seen: Container[tuple[int, int]] = (),
) -> Scenario:
    """Draws a scenario; whatever is given is kept, the rest follows the paper's probabilities.

    Scenarios with fewer than two cells that can be reached, or that fail `detour` or `seen`,
    are thrown away and drawn anew.

    Args:
        rng: decides everything.
        layout: 0..11; of several, one is drawn, by their probabilities.
        start_heading: 3 (east) or 1 (south).
        obstacles: how many, 0..13; or their cells, distinct ones of the border other than the start.
        detour: when given, only scenarios whose `detour` equals it.
        seen: keys (see `Scenario.key`) that must not come up.

    Raises:
        ValueError: for a cell, layout or heading out of range, or when no such scenario turns up.
    """
    check(layout, start_heading, obstacles)
    for _ in range(_MAX_DRAWS):
        the_layout = _draw_layout(rng, layout)
        cells = _draw_cells(rng, obstacles)
        obstacle_cells = _mask(cells)
        reachable = sorted(planner.paths(WALLS[the_layout] | obstacle_cells))
        if len(reachable) < 2 or key(the_layout, obstacle_cells) in seen:
            continue
        goal = int(rng.choice(reachable))
        if detour is not None and planner.needs_detour(WALLS[the_layout], obstacle_cells, goal) != detour:
            continue
        things = tuple(draw_obstacle(rng, cell) for cell in cells)
        heading = int(rng.choice(START_HEADINGS)) if start_heading is None else start_heading
        return Scenario(the_layout, heading, goal, things)
    raise ValueError(
        f"No scenario with layout={layout}, obstacles={obstacles}, detour={detour} and outside the seen ones "
        f"turned up in {_MAX_DRAWS} draws; loosen one of them."
    )


def check(
    layout: int | tuple[int, ...] | None = None,
    start_heading: int | None = None,
    obstacles: int | tuple[int, ...] | None = None,
) -> None:
    """What `draw` refuses before it draws.

    Raises:
        ValueError: for a cell, layout, heading or number out of range.
    """
    if layout is not None and not (np.size(layout) and _distinct(layout, range(len(WALLS)))):
        raise ValueError(f"layout={layout!r}: give one of 0..{len(WALLS) - 1}, or several of them, distinct.")
    if start_heading is not None and start_heading not in START_HEADINGS:
        raise ValueError(f"start_heading={start_heading} is neither 3 (east) nor 1 (south).")
    if obstacles is not None and not (
        _distinct(obstacles, range(MOST_OBSTACLES + 1))
        if np.ndim(obstacles) == 0
        else np.size(obstacles) <= MOST_OBSTACLES and _distinct(obstacles, OBSTACLE_CELLS)
    ):
        raise ValueError(
            f"obstacles={obstacles!r}: give their number, 0..{MOST_OBSTACLES}, or at most that many distinct "
            f"cells among {OBSTACLE_CELLS}."
        )


def _distinct(numbers: Any, among: Container[int]) -> bool:
    """Whether it is one of these integers, or several of them, none twice."""
    found = np.atleast_1d(numbers)
    if found.ndim > 1 or found.dtype == object:
        return False
    found = found.tolist()
    return len(found) == len(set(found)) and all(type(n) is int and n in among for n in found)


def _draw_layout(rng: np.random.Generator, layout: int | tuple[int, ...] | None) -> int:
    if layout is not None and np.ndim(layout) == 0:
        return int(np.asarray(layout))
    likely = LAYOUT_PROBABILITIES
    if layout is not None:
        likely = np.where(np.isin(np.arange(len(WALLS)), layout), likely, 0)
        likely = likely / likely.sum()
    return int(rng.choice(len(WALLS), p=likely))


def _draw_cells(rng: np.random.Generator, obstacles: int | tuple[int, ...] | None) -> tuple[int, ...]:
    if obstacles is None:
        count = 1 + int(rng.choice(MAX_OBSTACLES, p=COUNT_PROBABILITIES))
    elif np.ndim(obstacles) == 0:
        count = int(np.asarray(obstacles))
    else:
        return tuple(map(int, np.asarray(obstacles)))
    return tuple(rng.choice(OBSTACLE_CELLS, size=count, replace=False).tolist())


def _mask(cells: tuple[int, ...] | list[int]) -> NDArray[np.bool_]:
    mask = np.zeros(CELLS, np.bool_)
    mask[list(cells)] = True
    return mask
