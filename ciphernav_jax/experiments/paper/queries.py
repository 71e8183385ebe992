"""The attack by repeated queries: what do all answers together tell about obstacles? (paper: limitations).

The paper has no number; it argues that a robot that asks for the way to every goal learns at most where
obstacles are.

    python -m ciphernav_jax.experiments.paper.queries      # TIME a seed on two cores

The robot is honest but curious. It asks for the best action at every free cell, heading and goal of the map,
and collects the answers. As its own view it gives what it would see without obstacles, so that answers depend
on the map and on the cameras alone. Actions are computed in plaintext; that the secret evaluation gives the
same is checked on 2,000 questions ("agreement").

Attackers (`attack`) learn from the layout and from:

- layout: nothing else; what is known beforehand.
- rollouts: the answers along the answered paths, from the start to every goal.
- answers: to every question.
- camera features: the four cameras' plaintext features, the control.

obstacles: for each of the 15 cells that can hold one, accuracy and area under the curve; their means;
balanced accuracy; "exact": how often all 15 cells are right. shape, colour: of environments with one
obstacle, and for the colour no cone, which has its own texture; beside what always naming the most frequent
class would hit. Scored on the test and the validation environments, learned from the training environments.
"""

import time
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import tyro
from numpy.typing import NDArray

from ciphernav_jax.experiments.paper import attack
from ciphernav_jax.experiments.paper.accuracy import ROWS
from ciphernav_jax.experiments.paper.attack import ATTACKERS, Attacker, Floats
from ciphernav_jax.experiments.paper.runs import TEST, TRAIN, Options, console, train, world
from ciphernav_jax.models.classifier import ACTIONS
from ciphernav_jax.navigation import features, trained
from ciphernav_jax.navigation.features import Features
from ciphernav_jax.navigation.methods import METHODS
from ciphernav_jax.navigation.policies import best_action
from ciphernav_jax.secret import reveal, secure, share
from ciphernav_jax.world.dataset import Dataset
from ciphernav_jax.world.grid import CELLS, HEADINGS, MAX_ACTIONS, START, WALLS, move
from ciphernav_jax.world.scenario import COLOURS, OBSTACLE_CELLS, SHAPES

CHECKED = 2000
UNASKED = -1
CONE = SHAPES.index("cone")
BLOCK = 4  # environments answered at a time, some thousand questions each

Answers = NDArray[np.int8]
"""int8[N, 25, 4, 25]: the action by cell, heading and goal; UNASKED where one of the cells is a wall."""


def empty_views(dataset: Dataset) -> NDArray[np.int32]:
    """int32[12, 25, 4]: the view without obstacles, as an index into `views`, by layout, cell and heading.

    It is the one that comes up most: a view with an obstacle comes up once, where its shape, place and turn
    were drawn. -1 where none is known: walls.
    """
    found = np.full((len(WALLS), CELLS, len(HEADINGS)), -1, np.int32)
    agent, layouts = np.asarray(dataset.agent), np.asarray(dataset.layout)
    for layout in np.unique(layouts):
        here = agent[layouts == layout]
        for cell, heading in np.ndindex(CELLS, len(HEADINGS)):
            index, times = np.unique(here[:, cell, heading], return_counts=True)
            times[index < 0] = 0
            found[layout, cell, heading] = index[np.argmax(times)] if times.any() else -1
    return found


def questions(layout: int) -> tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.intp]]:
    """Cells, headings and goals of all questions in a layout, int[q] each."""
    free = np.flatnonzero(~WALLS[layout])
    cell, heading, goal = np.meshgrid(free, np.arange(len(HEADINGS)), free, indexing="ij")
    return cell.ravel(), heading.ravel(), goal.ravel()


def slots_of(seen: Features, views: Floats, env: NDArray, question: tuple[NDArray, ...]) -> tuple:
    """The classifier's input for single questions, with the views given in place of the robot's own.

    Args:
        seen: the environments' features.
        views: float32[12, 25, 4, 32], by layout, cell and heading.
        env: int[q].
        question: cells, headings and goals, int[q] each.
    """
    cell, heading, goal = question
    layout = seen.layout[env]
    cameras = (camera[env] for camera in seen.cameras)
    return (*cameras, views[layout, cell, heading], seen.maps[layout, cell, goal])


def ask(weights: Any, seen: Features, views: Floats) -> Answers:
    """All answers in all environments."""
    found = np.full((len(seen.layout), CELLS, len(HEADINGS), CELLS), UNASKED, np.int8)

    @jax.jit
    def answer(cameras, view, place):
        def of_one(cameras):
            own = [jnp.broadcast_to(camera, (len(view), camera.size)) for camera in cameras]
            return best_action(weights, (*own, view, place)).astype(jnp.int8)

        return jax.lax.map(of_one, cameras, batch_size=BLOCK)

    for layout in np.unique(seen.layout):
        envs = np.flatnonzero(seen.layout == layout)
        cell, heading, goal = questions(layout)
        cameras = tuple(camera[envs] for camera in seen.cameras)
        actions = answer(cameras, views[layout, cell, heading], seen.maps[layout, cell, goal])
        found[envs[:, None], cell, heading, goal] = np.asarray(actions)
    return found


def along_paths(answers: Answers, layout: NDArray, headings: NDArray) -> Answers:
    """The answers that a robot meets which, for every goal, asks at the start and goes on where the answers
    lead, until it is told to stop, or to run into a wall, or has asked 17 times; all others are UNASKED.
    """
    met = np.full_like(answers, UNASKED)
    env, goal = (x.ravel() for x in np.indices((len(answers), CELLS)))
    asked = ~WALLS[layout[env], goal]
    env, goal = env[asked], goal[asked]
    cell, heading = np.full(len(env), START), headings[env].astype(np.int64)
    for _ in range(MAX_ACTIONS):
        action = answers[env, cell, heading, goal].astype(np.int64)
        met[env, cell, heading, goal] = action
        following = move(cell, action).astype(np.int64)
        goes_on = (action > 0) & (following >= 0) & ~WALLS[layout[env], following]
        env, goal, cell, heading = env[goes_on], goal[goes_on], following[goes_on], action[goes_on] - 1
    return met


def agreement(weights: Any, seen: Features, views: Floats, answers: Answers, seed: int) -> dict[str, Any]:
    """How many of CHECKED questions, chosen at random, two parties answer as in plaintext."""
    asked = np.argwhere(answers != UNASKED)
    env, *question = asked[np.random.default_rng(seed).choice(len(asked), CHECKED)].T
    share_key, call_key = jax.random.split(jax.random.key(seed))
    slots = share(share_key, slots_of(seen, views, env, tuple(question)), parties=2)
    secret = np.asarray(reveal(secure(best_action)(call_key, weights, slots)))
    return attack.score(int(np.sum(secret == answers[env, *question])), CHECKED)


class Known(NamedTuple):
    """What one attacker knows: float32[n, d] of the training environments, float32[m, d] of the others."""

    train: Floats
    test: Floats

    def of(self, train: NDArray, test: NDArray) -> "Known":
        """Of some environments."""
        return Known(self.train[train], self.test[test])

    def beside(self, more: "Known") -> "Known":
        """And more of the same environments."""
        return Known(*(np.concatenate(sides, axis=1) for sides in zip(self, more, strict=True)))


def known_of_answers(train: Answers, test: Answers) -> Known:
    """Answers as 0 and 1: a column for each action to each question that some training environments give, and
    others do not.
    """
    columns = [side.reshape(len(side), -1) for side in (train, test)]
    parts = []
    for action in range(ACTIONS):
        given = columns[0] == action
        tells = np.flatnonzero(given.any(axis=0) & ~given.all(axis=0))
        parts.append([(side[:, tells] == action).astype(np.float32) for side in columns])
    return Known(*(np.concatenate(side, axis=1) for side in zip(*parts, strict=True)))


def obstacles(known: Known, truth: tuple[NDArray, NDArray], attacker: Attacker, seed: int) -> dict[str, Any]:
    """How well obstacles are found.

    Args:
        known: what the attacker knows.
        truth: bool[n, 15] and bool[m, 15], the cells that hold an obstacle.
        attacker, seed: who learns.

    Returns:
        accuracy, auc: their means over the cells; balanced: the mean of the shares of obstacles and of empty
        cells that are named rightly; exact: the score of all 15 cells at once; cells: by number their
        accuracy, and area under the curve. All in %.
    """
    right = truth[1]
    chance = attack.learn(known.train, truth[0].astype(int), known.test, 2, attacker, seed)[..., 1]
    named = chance > 0.5
    cells = {
        str(cell): {"accuracy": percent(np.mean(hit)), "auc": percent(area(p, there))}
        for cell, hit, p, there in zip(OBSTACLE_CELLS, (named == right).T, chance.T, right.T, strict=True)
    }
    return {
        "accuracy": percent(np.mean(named == right)),
        "balanced": percent((np.mean(named[right]) + np.mean(~named[~right])) / 2),
        "auc": percent(np.mean([area(p, there) for p, there in zip(chance.T, right.T, strict=True)])),
        "exact": attack.score(int((named == right).all(axis=1).sum()), len(right)),
        "cells": cells,
    }


def area(chance: NDArray, there: NDArray[np.bool_]) -> float:
    """The area under the curve: how often an obstacle has a greater chance than its absence; equals half."""
    pairs = chance[there][:, None] - chance[~there]
    return float(np.mean((pairs > 0) + 0.5 * (pairs == 0)))


def percent(part: float | np.floating) -> float:
    """100 * part, with two digits."""
    return round(100 * float(part), 2)


def property_of_one(dataset: Dataset, name: str) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The environments with one obstacle, and its shape or its colour; for the colour without cones."""
    shape, colour = (np.asarray(x)[:, 0] for x in (dataset.obstacle_shape, dataset.obstacle_colour))
    counted = np.asarray(dataset.obstacles).sum(axis=1) == 1
    if name == "colour":
        counted &= shape != CONE
    return np.flatnonzero(counted), (shape if name == "shape" else colour)[counted].astype(np.int64)


def properties(
    known: dict[str, Known], datasets: tuple[Dataset, list[Dataset]], name: str, seed: int
) -> dict:
    """How well the shape or the colour of an only obstacle is told, from each thing known.

    Returns:
        train: environments learned from; most frequent: the score of naming always the class that is the most
        frequent in training; and for each of `known` the attackers' scores.
    """
    (train, label), *others = (property_of_one(dataset, name) for dataset in (datasets[0], *datasets[1]))
    ends = np.cumsum([0, *map(len, datasets[1])])
    test = np.concatenate([rows + end for (rows, _), end in zip(others, ends, strict=False)])
    right = np.concatenate([of_one for _, of_one in others])
    classes = {"shape": len(SHAPES), "colour": len(COLOURS)}[name]
    usual = np.bincount(label).argmax()
    found: dict[str, Any] = {
        "train": len(label),
        "most frequent": attack.score(int(np.sum(right == usual)), len(right)),
    }
    for what, all_known in known.items():
        x, y = all_known.of(train, test)
        found[what] = {}
        for who, attacker in ATTACKERS.items():
            answers = attack.learn(x, label[:, None], y, classes, attacker, seed)[:, 0].argmax(axis=-1)
            found[what][who] = attack.score(int(np.sum(answers == right)), len(right))
    return found


@dataclass
class Queries(Options):
    """Ask a robot's every question, and infer from the answers where obstacles are, and which."""

    row: str = "plaintext"
    """Whose classifier answers: plaintext, plaintext-classifier, secret-2."""


def query(seed: int, options: Queries) -> tuple[dict[str, Any], dict[str, float]]:
    """Ask, and attack; see the head of this module.

    Returns:
        The results: agreement, questions (in an environment, on average), obstacles, shape, colour; and the
        seconds of asking and of the attacks.
    """
    rows = {row.name: row for row in ROWS}
    model = trained.load(train(rows[options.row], seed, rows, options))[1]
    weights = jax.tree.map(jnp.asarray, reveal(model.weights))
    environments, *others = datasets = [world(name, options.out) for name in ("train", "test", "validation")]
    began = time.perf_counter()
    seen = [
        features.standardise(trained.encode(dataset, METHODS["plaintext"], model), model.scales)
        for dataset in datasets
    ]
    views = seen[0].views[empty_views(environments)]
    answers = [ask(weights, each, views) for each in seen]
    agreed = agreement(model.weights, seen[1], views, answers[1], seed)
    seconds = {"ask": time.perf_counter() - began}

    met = [
        along_paths(found, each.layout, np.asarray(dataset.start_heading))
        for found, each, dataset in zip(answers, seen, datasets, strict=True)
    ]
    cameras = [np.concatenate(each.cameras, axis=1) for each in seen]
    layouts = [np.eye(len(WALLS), dtype=np.float32)[each.layout] for each in seen]

    def sides(of_all: list[NDArray]) -> tuple[NDArray, NDArray]:
        return of_all[0], np.concatenate(of_all[1:])

    layout = Known(*sides(layouts))
    known = {
        "layout": layout,
        "rollouts": layout.beside(known_of_answers(*sides(met))),
        "answers": layout.beside(known_of_answers(*sides(answers))),
        "camera features": layout.beside(Known(*attack.standard(*sides(cameras)))),
    }
    truth = sides([np.asarray(dataset.obstacles)[:, OBSTACLE_CELLS] for dataset in datasets])
    results: dict[str, Any] = {
        "agreement": agreed,
        "questions": round(float(np.mean(np.sum(answers[1] != UNASKED, axis=(1, 2, 3)))), 1),
        "obstacles": {},
    }
    for name, each in known.items():
        results["obstacles"][name] = {
            who: obstacles(each, truth, attacker, seed) for who, attacker in ATTACKERS.items()
        }
        console.print(name, {who: found["exact"] for who, found in results["obstacles"][name].items()})
    for name in ("shape", "colour"):
        some = {what: known[what] for what in ("answers", "camera features")}
        results[name] = properties(some, (environments, others), name, seed)
        console.print(name, results[name])
    seconds["attack"] = time.perf_counter() - began - seconds["ask"]
    return results, seconds


def main() -> None:
    """Ask and attack with every seed."""
    args = tyro.cli(Queries, description=__doc__)
    for seed in args.seeds:
        configuration = {"row": args.row, "train": TRAIN, "test": 2 * TEST, "checked": CHECKED}
        attack.recorded(
            args.results / f"queries-{seed}.json",
            seed,
            configuration | {"attack": attack.SETTINGS},
            partial(query, seed, args),
        )


if __name__ == "__main__":
    main()
