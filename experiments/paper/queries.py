"""The attack by repeated queries: what do all answers together tell about obstacles? (paper: limitations).

The paper has no number; it argues that a robot that asks for the way to every goal learns at most where
obstacles are.

    python -m experiments paper queries      # 5 to 10 minutes a seed on two cores

The robot is honest but curious: it asks for the best action again and again, and collects the answers.
Attackers (`attack`) learn from the layout and from:

- layout: nothing else; what is known beforehand.
- rollouts: the answers along its way from the start to every goal. It looks with its own eyes, so that some
  of what they tell is what it has seen itself.
- rollouts, empty view: the same, but as its own view it gives what it would see without obstacles. These
  answers depend on the map and on the cameras alone.
- answers: with that empty view, to every question: every free cell, heading and goal of the map. Most of them
  no honest robot would ask, and no training has answered.
- rollouts, right answers: as rollouts, with the planner's answers, which depend on obstacles' cells alone.
- camera features: the four cameras' plaintext features, the control.

obstacles: for each of the 15 cells that can hold one, accuracy and area under the curve; their means;
balanced accuracy; "exact": how often all 15 cells are right. shape, colour: of environments with one
obstacle, and for the colour no cone, which has its own texture; beside what always naming the most frequent
class would hit. Scored on the test and the validation environments, learned from the training environments.

Answers are computed in plaintext; that two parties give the same is checked on 2,000 questions ("agreement").
"questions": how many there are in an environment; "right": how many are answered as the planner would.
"""

import time
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from ciphernav_jax.command_line import read
from ciphernav_jax.learning.storage import fingerprint
from ciphernav_jax.models.classifier import ACTIONS
from ciphernav_jax.navigation import features, folders
from ciphernav_jax.navigation.features import Features
from ciphernav_jax.navigation.methods import METHODS
from ciphernav_jax.navigation.policies import best_action
from ciphernav_jax.ring import keys
from ciphernav_jax.secret import reveal, secure, share
from ciphernav_jax.world.dataset import Dataset
from ciphernav_jax.world.grid import CELLS, HEADINGS, MAX_ACTIONS, START, WALLS, move
from ciphernav_jax.world.planner import guide
from ciphernav_jax.world.scenario import COLOURS, OBSTACLE_CELLS, SHAPES
from experiments.paper import attack
from experiments.paper.accuracy import ROWS
from experiments.paper.attack import ATTACKERS, Attacker, Floats
from experiments.paper.runs import TEST, TRAIN, Options, console, train_row, world

CHECKED = 2000
UNASKED = -1
CONE = SHAPES.index("cone")
BLOCK = 4  # environments answered at a time, some thousand questions each

Answers = NDArray[np.int8]
"""int8[N, 25, 4, 25]: the action by cell, heading and goal; UNASKED where one of the cells is a wall."""


class Eyes(NamedTuple):
    """What the robot gives as its own view.

    Attributes:
        table: float32[V, 32], features of views.
        index: int32[N, 25, 4], rows of the table by environment, cell and heading; -1 where it cannot stand.
    """

    table: Floats
    index: NDArray[np.int32]


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


def slots_of(seen: Features, eyes: Eyes, env: NDArray, question: tuple[NDArray, ...]) -> tuple[Floats, ...]:
    """The classifier's input for single questions: int[q] environments, and cells, headings and goals."""
    cell, heading, goal = question
    cameras = (camera[env] for camera in seen.cameras)
    return (*cameras, eyes.table[eyes.index[env, cell, heading]], seen.maps[seen.layout[env], cell, goal])


def ask(weights: Any, seen: Features, eyes: Eyes) -> Answers:
    """All answers in all environments."""
    found = np.full((len(seen.layout), CELLS, len(HEADINGS), CELLS), UNASKED, np.int8)

    @jax.jit
    def answer(cameras, views, maps):
        def of_one(slots):
            *own, views = slots
            own = [jnp.broadcast_to(camera, (len(maps), camera.size)) for camera in own]
            views = jnp.repeat(views, len(maps) // len(views), axis=0)  # for all goals the same
            return best_action(weights, (*own, views, maps)).astype(jnp.int8)

        return jax.lax.map(of_one, (*cameras, views), batch_size=BLOCK)

    for layout in np.unique(seen.layout):
        envs = np.flatnonzero(seen.layout == layout)
        cell, heading, goal = questions(layout)
        index = eyes.index[envs][:, ~WALLS[layout]].reshape(len(envs), -1)
        cameras = tuple(camera[envs] for camera in seen.cameras)
        actions = np.asarray(answer(cameras, eyes.table[index], seen.maps[layout, cell, goal]))
        can_stand = eyes.index[envs[:, None], cell, heading] >= 0
        found[envs[:, None], cell, heading, goal] = np.where(can_stand, actions, UNASKED)
    return found


def right_answers(dataset: Dataset) -> Answers:
    """The planner's; UNASKED also where no path leads to the goal."""
    walls, obstacles = WALLS[dataset.layout], np.asarray(dataset.obstacles)
    found = np.full((len(walls), CELLS, len(HEADINGS), CELLS), UNASKED, np.int8)
    for goal in range(CELLS):
        right = guide(walls | obstacles, np.full(len(walls), goal))
        right[walls[:, goal] | obstacles[:, goal]] = UNASKED
        found[..., goal] = right[:, :, None]
    return found


def along_paths(answers: Answers, layout: NDArray, headings: NDArray) -> Answers:
    """The answers that a robot meets which, for every goal, asks at the start and goes on where the answers
    lead, until it is told to stop, or to go where it cannot, or has asked 17 times; all others are UNASKED.
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


def agreement(weights: Any, seen: Features, eyes: Eyes, answers: Answers, seed: int) -> dict[str, Any]:
    """How many of CHECKED questions, chosen at random, two parties answer as in plaintext."""
    asked = np.argwhere(answers != UNASKED)
    env, *question = asked[np.random.default_rng(seed).choice(len(asked), CHECKED)].T
    slots = slots_of(seen, eyes, env, tuple(question))
    key = keys.derive(keys.root(seed), "questions", fingerprint((weights, slots)))
    slots = share(key, slots, parties=2)
    secret = np.asarray(reveal(secure(best_action)(key, weights, slots)))
    return attack.score(int(np.sum(secret == answers[env, *question])), CHECKED)


def questions_asked(answers: Answers) -> float:
    """How many questions there are in an environment, on average."""
    return round(float(np.sum(answers != UNASKED) / len(answers)), 1)


def answered_rightly(answers: Answers, right: Answers) -> dict[str, Any]:
    """The score of the answers among those that have a right one; another path as short counts as wrong."""
    both = (answers != UNASKED) & (right != UNASKED)
    return attack.score(int(np.sum((answers == right)[both])), int(both.sum()))


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

    row: str = "secret-2"
    """Whose classifier answers: plaintext, plaintext-classifier, secret-2."""


def query(seed: int, options: Queries) -> tuple[dict[str, Any], dict[str, float]]:
    """Ask, and attack; see the head of this module.

    Returns:
        The results: agreement, questions, right, obstacles, shape, colour; and the seconds of asking and of
        the attacks.
    """
    rows = {row.name: row for row in ROWS}
    model = folders.load(train_row(rows[options.row], seed, rows, options))[1]
    weights = jax.tree.map(jnp.asarray, reveal(model.weights))
    environments, *others = datasets = [world(name, options) for name in ("train", "test", "validation")]
    began = time.perf_counter()
    seen = [
        features.standardise(model.encode(dataset, METHODS["plaintext"]), model.scales)
        for dataset in datasets
    ]
    empty = empty_views(environments)
    eyes = [Eyes(seen[0].views, empty[each.layout]) for each in seen]
    every = [ask(weights, each, empty_eyes) for each, empty_eyes in zip(seen, eyes, strict=True)]
    agreed = agreement(model.weights, seen[1], eyes[1], every[1], seed)
    right = [right_answers(dataset) for dataset in datasets]
    on_the_way = {
        "rollouts": [ask(weights, each, Eyes(each.views, each.view_index)) for each in seen],
        "rollouts, empty view": every,
        "rollouts, right answers": right,
    }
    answers = {
        name: [
            along_paths(found, each.layout, np.asarray(dataset.start_heading))
            for found, each, dataset in zip(of_all, seen, datasets, strict=True)
        ]
        for name, of_all in on_the_way.items()
    } | {"answers": every}
    seconds = {"ask": time.perf_counter() - began}

    def sides(of_all: list[NDArray]) -> tuple[NDArray, NDArray]:
        return of_all[0], np.concatenate(of_all[1:])

    known = {"layout": Known(*sides([np.eye(len(WALLS), dtype=np.float32)[each.layout] for each in seen]))}
    for name, of_all in answers.items():
        known[name] = known["layout"].beside(known_of_answers(*sides(of_all)))
    cameras = sides([np.concatenate(each.cameras, axis=1) for each in seen])
    known["camera features"] = known["layout"].beside(Known(*attack.standard(*cameras)))

    truth = sides([np.asarray(dataset.obstacles)[:, OBSTACLE_CELLS] for dataset in datasets])
    results: dict[str, Any] = {
        "agreement": agreed,
        "questions": {name: questions_asked(of_all[1]) for name, of_all in answers.items()},
        "right": {name: answered_rightly(of_all[1], right[1]) for name, of_all in answers.items()},
        "obstacles": {},
    }
    for name, each in known.items():
        found = {who: obstacles(each, truth, attacker, seed) for who, attacker in ATTACKERS.items()}
        results["obstacles"][name] = found
        console.print("obstacles", name, {who: of_one["exact"] for who, of_one in found.items()})
    for name in ("shape", "colour"):
        results[name] = properties(known, (environments, others), name, seed)
        console.print(name, results[name])
    seconds["attack"] = time.perf_counter() - began - seconds["ask"]
    return results, seconds


def main() -> None:
    """Ask and attack with every seed."""
    args = read(Queries(), __doc__)
    for seed in args.seeds:
        configuration = {"row": args.row, "train": TRAIN, "test": 2 * TEST, "checked": CHECKED}
        attack.recorded(
            args.results / f"queries-{seed}.json",
            seed,
            configuration | {"attack": attack.SETTINGS},
            partial(query, seed, args),
        )
