"""What the best plan made at the start reaches, by what is known there: what a model may know without a leak.

The paper's models: map only 74.0 %, first person 72.0 %, with deterministic start 88.8 %. A plan is a path
fixed at the start; the best one avoids obstacles with the greatest probability given what is known. Map only
can do no better than that (its view of the world never changes), whereas eyes see more as the robot goes.

    python -m experiments paper bounds             # a minute

Exact: all layouts, obstacle cells, goals and start headings, weighted by their probability, half of them with
a detour. "test": as the independent test set draws them; "unseen": without the pairs of layout and obstacle
cells that occur in the training set, on which a plan thus knows more beforehand. Nothing is trained, so there
is one file, RESULTS/bounds.json.
"""

import time
from collections import defaultdict
from collections.abc import Callable, Container, Sequence
from itertools import combinations
from typing import Any

import numpy as np

from ciphernav_jax import provenance
from ciphernav_jax.command_line import read
from ciphernav_jax.files import write_json
from ciphernav_jax.world import planner
from ciphernav_jax.world.grid import (
    CELLS,
    LAYOUT_PROBABILITIES,
    MAX_ACTIONS,
    RIGHT,
    SIDE,
    START,
    STEP_TABLE,
    WALLS,
)
from ciphernav_jax.world.scenario import COUNT_PROBABILITIES, OBSTACLE_CELLS, START_HEADINGS, key
from experiments.paper.runs import Options, console, training

TOP_LANE = tuple(range(1, SIDE))
LEFT_LANE = tuple(range(SIDE, CELLS, SIDE))

Case = tuple[int, int, int, frozenset[int], bool, float]
"""Layout, goal, start heading, obstacle cells, whether a detour is needed, probability."""


def cases(seen: Container[tuple[int, int]] = ()) -> list[Case]:
    """Every scenario without its pixels; the probabilities of either half add up to 1/2.

    `seen` are pairs of layout and obstacle cells that do not come up (`scenario.key`).
    """
    found = []
    for layout, walls in enumerate(WALLS):
        direct = planner.paths(walls)
        for count, probability in enumerate(COUNT_PROBABILITIES, 1):
            placed = list(combinations(OBSTACLE_CELLS, count))
            for cells in placed:
                obstacles = np.zeros(CELLS, bool)
                obstacles[list(cells)] = True
                paths = planner.paths(walls | obstacles)
                if len(paths) < 2 or key(layout, obstacles) in seen:
                    continue  # drawn anew
                weight = LAYOUT_PROBABILITIES[layout] * probability / len(placed) / len(paths)
                found += [
                    (layout, goal, frozenset(cells), path != direct[goal], weight)
                    for goal, path in paths.items()
                ]
    halves = [sum(case[-1] for case in found if case[3] == detour) for detour in (False, True)]
    return [
        (layout, goal, heading, cells, detour, weight / halves[detour] / 2 / len(START_HEADINGS))
        for layout, goal, cells, detour, weight in found
        for heading in START_HEADINGS
    ]


def plans(layout: int, goal: int) -> list[frozenset[int]]:
    """The cells of every path from the start to the goal that visits none twice and is short enough."""
    found: set[frozenset[int]] = set()

    def go(cell: int, visited: frozenset[int]) -> None:
        if cell == goal:
            found.add(visited)
        elif len(visited) < MAX_ACTIONS:
            for following in STEP_TABLE[cell, 1:].tolist():
                if following >= 0 and not WALLS[layout, following] and following not in visited:
                    go(following, visited | {following})

    go(START, frozenset([START]))
    return [cells for cells in found if not any(other < cells for other in found)]


def best(cases: Sequence[Case], known: Callable[[Case], Any]) -> dict[str, float]:
    """The accuracy in percent of the best plan for what is `known` of a case besides layout and goal."""
    groups = defaultdict(list)
    for case in cases:
        groups[case[0], case[1], known(case)].append(case)
    won = {True: 0.0, False: 0.0}
    paths: dict[tuple[int, int], list[frozenset[int]]] = {}
    for (layout, goal, _), members in groups.items():
        if (layout, goal) not in paths:
            paths[layout, goal] = plans(layout, goal)
        _, halves = max((_won(path, members) for path in paths[layout, goal]), key=lambda result: result[0])
        for detour, weight in halves.items():
            won[detour] += weight
    detour, no_detour = 200 * won[True], 200 * won[False]
    return {"detour": detour, "no_detour": no_detour, "overall": (detour + no_detour) / 2}


def _won(path: frozenset[int], members: list[Case]) -> tuple[float, dict[bool, float]]:
    halves = {True: 0.0, False: 0.0}
    for *_, obstacles, detour, weight in members:
        if not path & obstacles:
            halves[detour] += weight
    return sum(halves.values()), halves


def lane(heading: int) -> tuple[int, ...]:
    """The cells ahead of a robot at the start."""
    return TOP_LANE if heading == RIGHT - 1 else LEFT_LANE


KNOWN: dict[str, Callable[[Case], Any]] = {
    "map": lambda case: None,
    "map and top lane": lambda case: case[3] & set(TOP_LANE),
    "map and lane in view at the start": lambda case: (case[2], case[3] & set(lane(case[2]))),
    "map and all obstacles": lambda case: case[3],
}


def main() -> None:
    """Compute all bounds, print and write them."""
    args = read(Options(), __doc__)
    began = time.perf_counter()
    drawn = {"test": cases(), "unseen": cases(training(args.size.train).pairs())}
    results = {
        name: {test_set: best(of_set, known) for test_set, of_set in drawn.items()}
        for name, known in KNOWN.items()
    }
    for name, sets in results.items():
        for test_set, accuracy in sets.items():
            numbers = ", ".join(f"{half} {value:.2f} %" for half, value in accuracy.items())
            console.print(f"{name}, {test_set}: {numbers}")
    document = {
        "versions": provenance.versions(),
        "machine": provenance.machine(),
        "at": provenance.now(),
        "seconds": time.perf_counter() - began,
        "scenarios": {name: len(of_set) // len(START_HEADINGS) for name, of_set in drawn.items()},
        "results": results,
    }
    write_json(args.results / "bounds.json", document)
