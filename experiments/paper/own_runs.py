"""The attacks on the project's own runs: with the keys that training and driving derive.

    python -m experiments paper own_runs      # a quarter of an hour a seed on two cores, 16 GB

It takes the trainings of the rows `secret-2` and `secret-5` (`accuracy`), which are made where they are
missing. `reconstruction` gives each environment a random key of its own. Here one seed's whole run is looked
at together: what is shared for training (weights, velocity, loss and all samples), the first steps of it, and
of either test set what is shared for the first decisions, and these. All have the very keys of
`navigation.trainings`, so that a mask which any two of them had in common would show.

The coalitions are those of all parties but one: they know all that smaller ones know. Their shares are added
up. They know the initial weights, and that the velocity and the loss begin at 0; no key, and no mask but by
what they see.

- exact: is a hidden value the difference or the sum of two words? Of all pairs of all numbers, within a run
  and from one to the other (`exact`): of added shares, of each member's own shares of what is shared, and
  of what is dealt, sent and opened. Words that are shared by exclusive or are left out.
- learned: is an obstacle in a camera's view? The attackers (`attack`) look at the cameras' shares of two of
  the three data sets, equal rows together, and their difference. They learn from half of the environments,
  of as many as the smaller data set has.
"""

import functools
import itertools
import time
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from numpy.typing import NDArray

from ciphernav_jax.command_line import read
from ciphernav_jax.learning import fitting
from ciphernav_jax.learning.columns import ANSWERS, picked
from ciphernav_jax.learning.sgd import sgd_step
from ciphernav_jax.navigation import classifier, driving, features, folders, policies, trainings
from ciphernav_jax.navigation.classifier import FreshClassifier
from ciphernav_jax.navigation.features import Features
from ciphernav_jax.navigation.owners import CAMERAS, SLOTS
from ciphernav_jax.navigation.samples import Samples, start_headings, training_samples
from ciphernav_jax.parties import sharing
from ciphernav_jax.protocols import Protocol
from ciphernav_jax.secret import Secret, is_secret, secure, view
from ciphernav_jax.secret.views import View
from ciphernav_jax.world.grid import START
from experiments.paper import attack, exact
from experiments.paper.accuracy import ROWS
from experiments.paper.attack import ATTACKERS, Words
from experiments.paper.exact import Sight
from experiments.paper.reconstruction import attacked, labels
from experiments.paper.runs import TEST, TEST_SETS, TRAIN, Options, console, train_row, world

STEPS = 2
PARTIES = (2, 5)


class Seen(NamedTuple):
    """A training or a drive as all parties see it.

    Attributes:
        public: by name the shares of what everybody knows.
        secret: those of what must stay hidden.
        views: of the steps or of the decisions.
    """

    public: dict[str, Secret]
    secret: dict[str, Secret]
    views: list[View]


def training(
    key: Array,
    seen: Features,
    samples: Samples,
    recipe: FreshClassifier,
    seed: int,
    parties: int,
    protocol: Protocol | None = None,
    steps: int = STEPS,
) -> Seen:
    """The first steps of the training of a classifier that has this key (`learning.fit`), once more."""
    table = classifier.table(seen, samples, parties)
    start, data = fitting.share_at_start(key, classifier.initial(seed), table, parties, protocol)
    loss = fitting.share_loss(key, 0, jnp.float32(0), parties, protocol)
    state, views = (*start, loss), []
    step = observed_step(recipe, protocol or Protocol())
    numbers, decays, rows = table.batches(recipe, seed, np.arange(steps))
    for index, number in enumerate(numbers):
        batch = picked(data, jax.tree.map(lambda of_steps, index=index: of_steps[index], rows))
        state, seen_of_step = step(fitting.step_key(key, number), state, *batch, decays[index])
        views.append(seen_of_step)
    columns, actions = data
    public = {"weights": start[0], "velocity": start[1], "loss": loss}
    secret = dict(zip((*table.columns, ANSWERS), (*columns, actions), strict=True))
    return Seen(_leaves(public), secret, views)


def drive(
    key: Array, params: Any, seen: Features, headings: NDArray, parties: int, protocol: Protocol | None = None
) -> Seen:
    """The first decisions of `policies.secret_policy`, which has these arguments, once more.

    Args:
        headings: int64[N], where the robots look at the start.
    """
    every = np.arange(len(seen.goal))
    robot = seen.robot(every, np.full(len(every), START), headings, seen.goal)
    slots = (
        *policies.share_cameras(key, seen, parties, protocol),
        *policies.share_robot(key, 0, robot, parties, protocol),
    )
    decide = observed_decision(protocol or Protocol())
    _, decided = decide(policies.decision_key(key, 0), params, slots)
    return Seen({}, dict(zip(SLOTS, slots, strict=True)), [decided])


# Kept, so that they are compiled once.
@functools.cache
def observed_step(recipe: FreshClassifier, protocol: Protocol) -> Any:
    """A training step with its view."""
    return view(secure(partial(sgd_step, classifier.CLASSIFIER, recipe=recipe), protocol=protocol))


@functools.cache
def observed_decision(protocol: Protocol) -> Any:
    """A decision with its view."""
    return view(secure(policies.best_action, protocol=protocol))


def _leaves(values: Mapping[str, Any]) -> dict[str, Secret]:
    found = jax.tree_util.tree_leaves_with_path(values, is_leaf=is_secret)
    return {jax.tree_util.keystr(path, simple=True, separator=" "): leaf for path, leaf in found}


def coalitions(parties: int) -> list[tuple[int, ...]]:
    """All of all parties but one."""
    return list(itertools.combinations(range(parties), parties - 1))


def sights(runs: Mapping[str, Seen], coalition: Sequence[int]) -> list[Sight]:
    """All numbers that a coalition sees of several runs, for `exact.attack`."""
    found = []
    for name, run in runs.items():
        for public, shared in ((True, run.public), (False, run.secret)):
            for what, secret in shared.items():
                hidden = np.asarray(sharing.join_sum(secret.shares))
                found.append(Sight(f"{name}, {what}", _joined(secret, coalition), hidden, public))
                if len(coalition) > 1:
                    own = np.asarray(secret.shares[np.asarray(coalition)])
                    found.append(Sight(f"{name}, {what}, each member's", own))
        for number, seen in enumerate(run.views):
            # Inputs are shares from above, or computed from what is seen.
            dealt_and_sent = seen.of(coalition).numbers[len(seen.inputs) :]
            words = np.concatenate([np.asarray(x).reshape(-1) for x in dealt_and_sent])
            found.append(Sight(f"{name}, view {number}", words))
    return found


def _joined(secret: Secret, coalition: Sequence[int]) -> Words:
    return np.asarray(sharing.join_sum(secret.shares[np.asarray(coalition)]))


def rows(one: Seen, other: Seen, coalition: Sequence[int]) -> Words:
    """uint64[N, 384]: a coalition's words of all cameras, of one run's environments, of another's in equal
    places, and their difference; as many as both have.
    """
    words = [
        np.concatenate([_joined(run.secret[camera], coalition) for camera in CAMERAS], axis=1)
        for run in (one, other)
    ]
    count = min(map(len, words))
    mine, others = (x[:count] for x in words)
    return np.concatenate([mine, others, mine - others], axis=1)


def learned(words: Words, truth: NDArray[np.bool_], seed: int) -> dict[str, Any]:
    """The scores of the attackers, by camera. Half of `rows` is to learn from; truth is bool[N, 4], labels of
    at least as many.
    """
    half = len(words) // 2
    sides, known = (words[:half], words[half:]), (truth[:half], truth[half : len(words)])
    found: dict[str, dict[str, Any]] = {name: {} for name in ATTACKERS}
    for camera, name in enumerate(CAMERAS):
        for attacker, score in attacked(attack.numbers(*sides), known, camera, seed)[1].items():
            found[attacker][name] = score
    return found


def attacks(
    runs: Mapping[str, Seen], truth: Mapping[str, NDArray], parties: int, seed: int
) -> dict[str, Any]:
    """Both attacks by every coalition."""
    results = {}
    for coalition in coalitions(parties):
        known = "parties " + " and ".join(map(str, coalition)) + f" of {parties}"
        found: dict[str, Any] = {"exact": exact.attack(sights(runs, coalition)), "learned": {}}
        for one, other in itertools.permutations(runs, 2):
            pair = rows(runs[one], runs[other], coalition)
            found["learned"][f"{one}, beside {other}"] = learned(pair, truth[one], seed)
        results[known] = found
        total = {what: sum(of[what] for of in found["exact"].values()) for what in exact.FOUND}
        console.print(known, total)
    return results


def own_runs(seed: int, options: Options) -> tuple[dict[str, Any], dict[str, float]]:
    """All attacks on the rows of 2 and 5 parties, and the seconds that each took."""
    known = {row.name: row for row in ROWS}
    datasets = {"training": world("train", options)} | {name: world(name, options) for name in TEST_SETS}
    truth = {name: labels(dataset) for name, dataset in datasets.items()}
    results, seconds = {}, {}
    for parties in PARTIES:
        began = time.perf_counter()
        row = known[f"secret-{parties}"]
        config, model = folders.load(train_row(row, seed, known, options))
        protocol, method = Protocol(**config["protocol"]), folders.sees(config)
        runs = {}
        for name, dataset in datasets.items():
            seen = features.standardise(model.encode(dataset, method), model.scales)
            if name == "training":
                assert isinstance(row.recipe, FreshClassifier)
                samples = training_samples(dataset, method, seed, row.recipe.errands, row.recipe.stray)
                key = trainings.training_key(config, dataset)
                runs[name] = training(key, seen, samples, row.recipe, seed, parties, protocol)
            else:
                key = driving.driving_key(dataset, config, model, seed, parties, protocol)
                headings = start_headings(dataset, method)
                runs[name] = drive(key, model.weights, seen, headings, parties, protocol)
        results |= attacks(runs, truth, parties, seed)
        seconds[row.name] = time.perf_counter() - began
    return results, seconds


def main() -> None:
    """Attack the runs of every seed."""
    args = read(Options(), __doc__)
    configuration = {"train": TRAIN, "test": TEST, "steps": STEPS, "attack": attack.SETTINGS}
    for seed in args.seeds:
        path = args.results / f"own_runs-{seed}.json"
        attack.recorded(path, seed, configuration, partial(own_runs, seed, args))
