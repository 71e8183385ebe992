"""The reconstruction attack: is there an obstacle in a camera's view? (paper: section 5, privacy).

The paper: chance 50 %, on shares 49.7 %, on plaintext features 93.6 %.

    python -m experiments paper reconstruction      # a quarter of an hour a seed on two cores

A camera's label is whether an obstacle stands in its lane. Training and test environments are halved between
the two labels, so that chance is 50 %. For each row, camera and attacker (`attack`) the file has hits and
trials; "all" adds the cameras up. Robots stand at their start. What the attacker sees:

- features: the camera's 32 plaintext features; must be far above chance, the more as our encoders learn what
  stands in the lanes. features, actions alone: of encoders that learn from actions alone, like the paper's.
- share, share bits: the robot's share of them, of two: as 32 numbers, as 2,048 bits.
- forward: all that the robot sees of a decision (`best_action`, two parties, public weights): its shares of
  all inputs, its part of the dealer's randomness, all that is opened and all that the other party sends. Not
  what it holds in the clear, its own view and map, nor the output.
- forward and output: with it the action, and the shares that open it. The action is meant to be known, and
  tells something. output: that alone.
- forward, secret weights: the same with shared weights. Of numbers with an axis for the batch the one
  row; of all others, weights and bits, 1,000 words chosen once.
- forward, 5 parties: the same as forward of bottom_left's owner, who attacks the others' cameras.
- all but one: four of five parties put together what they see, and attack the fifth's camera. Their shares
  are added up.
- training step: what the robot sees of one step (two parties, secret weights, a batch of 4 whose first
  sample is the environment attacked and whose others are fixed). Of numbers with an axis for the batch the
  first row; of all others, weights, gradients and bits, 1,000 words chosen once. Learned from 4,000 training
  environments, the other rows from 15,000.

Planted leaks, which must be found, as must the features:

- forward, reused masks; training step, reused masks: every environment is shared, and dealt for, with the
  same random key.
- forward, no mask: the camera owners give the robot their features as they are, among all the other words.
- all but one, no own share: the camera owners split their features among the other four, and keep 0. Each one
  of them sees nothing, all of them together everything.
"""

import time
from collections.abc import Callable, Collection, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from numpy.typing import NDArray

from ciphernav_jax.command_line import read
from ciphernav_jax.learning.sgd import sgd_step
from ciphernav_jax.models.classifier import ACTIONS
from ciphernav_jax.navigation import classifier, features, folders
from ciphernav_jax.navigation.classifier import CLASSIFIER
from ciphernav_jax.navigation.features import Features
from ciphernav_jax.navigation.folders import Trained
from ciphernav_jax.navigation.methods import METHODS
from ciphernav_jax.navigation.owners import CAMERAS
from ciphernav_jax.navigation.policies import best_action
from ciphernav_jax.navigation.samples import start_headings, teacher_forced
from ciphernav_jax.ring import keys
from ciphernav_jax.secret import Secret, reveal, secure, share, view
from ciphernav_jax.world.dataset import Dataset
from ciphernav_jax.world.grid import START
from ciphernav_jax.world.poses import LANES
from experiments.paper import attack
from experiments.paper.accuracy import FRESH, ROWS
from experiments.paper.attack import ATTACKERS, Floats, Words
from experiments.paper.runs import TEST, TRAIN, Options, console, train_row, world

BATCH = 4
STEP_TRAIN = 4000
SOME = 1000
ROBOT = (0,)


class Rows(NamedTuple):
    """Environments with their robots at the start; N rows each.

    Attributes:
        slots: the six slots of the classifier's input, float32[N, 32 or 128].
        action: float32[N, 5], the right action, one-hot.
    """

    slots: tuple[Floats, ...]
    action: Floats


Observe = Callable[[Array, Rows], Array]
"""What is seen, uint64[w], of one environment, from a random key and its row."""
Share = Callable[[Array, Any], Any]


def labels(dataset: Dataset) -> NDArray[np.bool_]:
    """bool[N, 4]: whether an obstacle stands in each camera's lane."""
    return np.any(np.asarray(dataset.obstacles)[:, LANES], axis=-1)


def at_start(dataset: Dataset, seen: Features) -> Rows:
    """Every environment at its start."""
    every = np.arange(len(dataset))
    slots = seen.slots(every, np.full(len(dataset), START), start_headings(dataset, METHODS["plaintext"]))
    return Rows(slots, np.eye(ACTIONS, dtype=np.float32)[dataset.actions[:, 0]])


def collect(observe: Observe, rows: Rows, seed: int, *, block: int = 64, reused: bool = False) -> Words:
    """uint64[N, w]: what is seen of each environment, each with a key of its own, or all with one."""
    count = len(rows.action)
    key = keys.derive(keys.root(seed), "environment")
    own = jnp.broadcast_to(key, count) if reused else keys.derive(key, np.arange(count))
    run = jax.jit(lambda *args: jax.lax.map(lambda one: observe(*one), args, batch_size=block))
    return np.asarray(run(own, rows))


def own_features(camera: int) -> Observe:
    """A camera's features in the clear, in fixed point: what both of two parties know together."""
    return lambda key, row: share(key, row.slots[camera], parties=2).shares.sum(axis=0, dtype=jnp.uint64)


def robots_share(camera: int) -> Observe:
    """The robot's share of a camera's features, of two parties."""
    return lambda key, row: share(key, row.slots[camera], parties=2).shares[0]


def forward(
    weights: Any,
    coalition: Sequence[int],
    sharing: Share,
    *,
    secret_weights: bool = False,
    parts: Collection[str] = ("view",),
) -> Observe:
    """What the parties of a coalition see together of one decision.

    Args:
        weights: the classifier's, in the clear.
        coalition: numbers of parties.
        sharing: shares slots, or weights too, from a key.
        secret_weights: whether the weights are shared too; then `_of_first` is taken.
        parts: of "view" and "output"; the output is the action, one-hot, and all shares of it.
    """
    observed = view(secure(best_action))

    def observe(key: Array, row: Rows) -> Array:
        slots = sharing(keys.derive(key, "slots"), tuple(slot[None] for slot in row.slots))
        params = sharing(keys.derive(key, "weights"), weights) if secret_weights else weights
        result, seen = observed(key, params, slots)
        numbers, bits = seen.of(coalition)
        action = jax.nn.one_hot(reveal(result)[0], ACTIONS, dtype=jnp.uint64)
        words = {
            "view": _of_first(numbers, 1, bits) if secret_weights else [*numbers, *bits],
            "output": [action, result.shares],
        }
        return _flat([x for part in parts for x in words[part]])

    return observe


def training_step(weights: Any, others: Rows, sharing: Share) -> Observe:
    """What the robot sees of a training step on the environment and `others`; see the head of this module."""
    recipe = replace(FRESH, batch=BATCH)
    observed = view(secure(partial(sgd_step, CLASSIFIER, recipe=recipe)))
    velocity = jax.tree.map(np.zeros_like, weights)

    def observe(key: Array, row: Rows) -> Array:
        slots, labels = jax.tree.map(lambda own, rest: jnp.concatenate([own[None], rest]), row, others)
        args = sharing(key, ((weights, velocity, jnp.float32(0)), slots, labels))
        numbers, bits = observed(key, *args, jnp.float32(1))[1].of(ROBOT)
        return _flat(_of_first(numbers, BATCH, bits))

    return observe


def _of_first(numbers: list[Array], batch: int, bits: list[Array]) -> list[Array]:
    """The first rows of what has an axis for the batch, and SOME words of the rest, always the same."""
    first = [x[0] for x in numbers if x.shape[:1] == (batch,)]
    rest = [x for x in numbers if x.shape[:1] != (batch,)] + bits
    size = sum(x.size for x in rest)
    return [*first, _flat(rest)[np.random.default_rng(0).choice(size, min(SOME, size), replace=False)]]


def _flat(arrays: Sequence[Array]) -> Array:
    return jnp.concatenate([x.reshape(-1) for x in arrays])


def to_robot_as_they_are(sharing: Share) -> Share:
    """A planted leak: the robot's shares of the cameras' slots are the slots, all other shares 0."""

    def leaky(key: Array, slots: Any) -> Any:
        return _cameras(
            sharing(key, slots),
            lambda camera, shares: jnp.zeros_like(shares).at[0].set(shares.sum(axis=0, dtype=jnp.uint64)),
        )

    return leaky


def keeping_nothing(sharing: Share) -> Share:
    """A planted leak: the owners of cameras, parties 1 to 4, add their own share to the robot's."""

    def leaky(key: Array, slots: Any) -> Any:
        return _cameras(
            sharing(key, slots),
            lambda camera, shares: shares.at[0].add(shares[camera + 1]).at[camera + 1].set(0),
        )

    return leaky


def _cameras(slots: tuple[Secret, ...], change: Callable[[int, Array], Array]) -> tuple[Secret, ...]:
    changed = [replace(slot, shares=change(i, slot.shares)) for i, slot in enumerate(slots[: len(CAMERAS)])]
    return (*changed, *slots[len(CAMERAS) :])


class Look(NamedTuple):
    """What an attacker looks at.

    Attributes:
        observe: what is seen of an environment.
        rows: the training and the test environments.
        cameras: those attacked.
        reused: whether all environments have the same random key.
        read: words of training and test environments as floats.
    """

    observe: Observe
    rows: tuple[Rows, Rows]
    cameras: Sequence[int] = range(len(CAMERAS))
    reused: bool = False
    read: Callable[[Words, Words], tuple[Floats, Floats]] = attack.numbers


def looks(
    weights: Any, rows: tuple[Rows, Rows], standardised: tuple[Rows, Rows], actions_alone: tuple[Rows, Rows]
) -> dict[str, list[Look]]:
    """Every row of the table, by its name: one look for all cameras, or one for each.

    Args:
        weights: the plaintext row's classifier.
        rows: the training and the test environments at their start.
        standardised: the same as secret training shares them.
        actions_alone: the same with encoders that learned from actions alone.
    """
    each = range(len(CAMERAS))
    two, five = partial(share, parties=2), partial(share, parties=5)
    robots = partial(forward, weights, ROBOT, two)
    others = _first(standardised[0], BATCH - 1, after=STEP_TRAIN)
    step = training_step(classifier.initial(0), others, two)
    # A step takes as long as a hundred decisions, and what the reused masks leak needs few environments.
    some = (_first(standardised[0], STEP_TRAIN), standardised[1])
    few = (_first(standardised[0], STEP_TRAIN // 4), _first(standardised[1], STEP_TRAIN // 4))

    def all_but(camera: int, sharing: Share) -> Look:
        coalition = [party for party in range(5) if party != camera + 1]
        return Look(forward(weights, coalition, sharing), rows, [camera])

    return {
        "features": [Look(own_features(camera), rows, [camera]) for camera in each],
        "features, actions alone": [Look(own_features(camera), actions_alone, [camera]) for camera in each],
        "share": [Look(robots_share(camera), rows, [camera]) for camera in each],
        "share bits": [Look(robots_share(camera), rows, [camera], read=attack.bits) for camera in each],
        "forward": [Look(robots(), rows)],
        "forward and output": [Look(robots(parts=("view", "output")), rows)],
        "output": [Look(robots(parts=("output",)), rows)],
        "forward, secret weights": [Look(robots(secret_weights=True), rows)],
        "forward, 5 parties": [Look(forward(weights, [1], five), rows, each[1:])],
        "all but one": [all_but(camera, five) for camera in each],
        "training step": [Look(step, some)],
        "forward, reused masks": [Look(robots(), rows, reused=True)],
        "forward, no mask": [Look(forward(weights, ROBOT, to_robot_as_they_are(two)), rows)],
        "all but one, no own share": [all_but(camera, keeping_nothing(five)) for camera in each],
        "training step, reused masks": [Look(step, few, reused=True)],
    }


def _first(rows: Rows, count: int, after: int = 0) -> Rows:
    return jax.tree.map(lambda x: x[after : after + count], rows)


def outcome(row: Sequence[Look], truth: tuple[NDArray, NDArray], seed: int) -> dict[str, Any]:
    """Attack all cameras of a row.

    Args:
        row: the looks.
        truth: bool[N, 4], the training and the test environments' labels.
        seed: of shares, dealer and attackers.

    Returns:
        words: how many are seen of an environment; train: environments learned from, by camera; for each
        attacker the score by camera, and in "all" that of their sum.
    """
    found: dict[str, Any] = {"words": 0, "train": {}} | {name: {} for name in ATTACKERS}
    for look in row:
        # Who reuses a key has it for the test environments too.
        words = [
            collect(look.observe, rows, 2 * seed + (i and not look.reused), reused=look.reused)
            for i, rows in enumerate(look.rows)
        ]
        found["words"] = words[0].shape[1]
        seen = look.read(words[0], words[1])
        for camera in look.cameras:
            found["train"][CAMERAS[camera]], scores = attacked(seen, truth, camera, seed)
            for name, score in scores.items():
                found[name][CAMERAS[camera]] = score
    for name in ATTACKERS:
        scores = list(found[name].values())
        found[name]["all"] = attack.score(*(sum(s[part] for s in scores) for part in ("hits", "trials")))
    return found


def attacked(
    seen: tuple[Floats, Floats], truth: tuple[NDArray, NDArray], camera: int, seed: int
) -> tuple[int, dict[str, Any]]:
    """How many environments the attackers learn a camera's labels from, and the score of each.

    Args:
        seen: float32[n, d], rows of training and of test environments.
        truth: bool[N, 4], the labels of at least as many.
        camera: whose.
        seed: of the attackers.
    """
    known = [of_all[: len(x), camera].astype(np.int64) for of_all, x in zip(truth, seen, strict=True)]
    chosen = [attack.balanced(of_all, seed) for of_all in known]
    x, test = (of_all[rows] for of_all, rows in zip(seen, chosen, strict=True))
    y, right = (of_all[rows] for of_all, rows in zip(known, chosen, strict=True))
    scores = {}
    for name, attacker in ATTACKERS.items():
        answers = attack.learn(x, y[:, None], test, 2, attacker, seed)[:, 0].argmax(axis=-1)
        scores[name] = attack.score(int(np.sum(answers == right)), len(right))
    return len(x), scores


def reconstruct(seed: int, options: Options) -> tuple[dict[str, Any], dict[str, float]]:
    """All rows, and the seconds that each took; see `outcome`."""
    cameras = METHODS["plaintext"]
    rows = {row.name: row for row in ROWS}
    datasets = world("train", options), world("test", options)

    def encoded(row: str) -> tuple[Trained, list[Features]]:
        model = folders.load(train_row(rows[row], seed, rows, options))[1]
        return model, [model.encode(dataset, cameras) for dataset in datasets]

    def starts(seen: list[Features]) -> tuple[Rows, Rows]:
        return at_start(datasets[0], seen[0]), at_start(datasets[1], seen[1])

    model, seen = encoded("plaintext")
    scales = features.fit_scales(seen[0], teacher_forced(datasets[0], cameras))
    standardised = starts([features.standardise(each, scales) for each in seen])
    attacks = looks(model.weights, starts(seen), standardised, starts(encoded("plaintext-actions-alone")[1]))
    truth = labels(datasets[0]), labels(datasets[1])
    results, seconds = {}, {}
    for name, row in attacks.items():
        began = time.perf_counter()
        results[name] = outcome(row, truth, seed)
        seconds[name] = time.perf_counter() - began
        console.print(name, {attacker: results[name][attacker]["all"] for attacker in ATTACKERS})
    return results, seconds


def main() -> None:
    """Attack with every seed."""
    args = read(Options(), __doc__)
    configuration = {"train": TRAIN, "test": TEST, "step": STEP_TRAIN, "batch of a step": BATCH, "some": SOME}
    for seed in args.seeds:
        attack.recorded(
            args.results / f"reconstruction-{seed}.json",
            seed,
            configuration | {"attack": attack.SETTINGS},
            partial(reconstruct, seed, args),
        )
