"""Attackers that learn: linear classifiers and a network, the same for every attack.

They are trained on what is seen of the training environments, and scored on environments that they have not
met. Training stops when the loss on a tenth that is held out falls no more, so that an attacker who finds
nothing answers like the prior, and not like noise that it has learned by heart.
"""

import functools
import itertools
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import optax
from numpy.typing import NDArray

from ciphernav_jax import provenance
from ciphernav_jax.files import read_json, write_json

Floats = NDArray[np.float32]
Words = NDArray[np.uint64]


@dataclass(frozen=True)
class Attacker:
    """How an attacker learns.

    Attributes:
        hidden: widths of the hidden layers; none is logistic regression.
        columns: looks only at so many columns, those that go most with the labels in training. What leaks in
            few of thousands of columns is found like this; None looks at all.
    """

    hidden: tuple[int, ...] = ()
    columns: int | None = None


ATTACKERS = {"linear": Attacker(), "mlp": Attacker(hidden=(64, 64)), "few columns": Attacker(columns=32)}

EPOCHS, PATIENCE, BATCH, RATE, DECAY = 100, 5, 250, 1e-3, 1e-2
SETTINGS = {
    "attackers": {name: asdict(attacker) for name, attacker in ATTACKERS.items()},
    "epochs": EPOCHS,
    "patience": PATIENCE,
    "batch": BATCH,
    "learning_rate": RATE,
    "weight_decay": DECAY,
}


def learn(train: Floats, labels: NDArray, test: Floats, classes: int, attacker: Attacker, seed: int):
    """Learn labels from rows, and say what the test rows' are.

    Args:
        train: float32[n, d], at least 20 rows.
        labels: int[n, l], each 0..classes - 1; l questions of as many classes.
        test: float32[m, d].
        classes: k.
        attacker: how.
        seed: of the weights and of the order.

    Returns:
        float32[m, l, k]: probabilities.
    """
    rng = np.random.default_rng(seed)
    held, rows = np.split(rng.permutation(len(train)), [len(train) // 10])
    if attacker.columns:
        # Chosen without those held out, which are to say when to stop.
        telling = _correlation(train[rows], labels[rows], classes)
        chosen = np.argsort(-telling, kind="stable")[: attacker.columns]
        train, test = train[:, chosen], test[:, chosen]
    widths = (train.shape[1], *attacker.hidden, labels.shape[1] * classes)
    params = [
        (rng.normal(size=(a, b)).astype(np.float32) * np.float32(np.sqrt(2 / a)), np.zeros(b, np.float32))
        for a, b in itertools.pairwise(widths[:-1])
    ]
    params.append((np.zeros(widths[-2:], np.float32), np.zeros(widths[-1], np.float32)))
    state = (params, _optimiser().init(params))
    x, y = jnp.asarray(train), jnp.asarray(labels, jnp.int32)
    best, kept, since = np.inf, params, 0
    for _ in range(EPOCHS):
        order = rng.permutation(rows)[: max(1, len(rows) // BATCH) * BATCH]
        state = _epoch(state, x, y, order.reshape(-1, min(BATCH, len(order))), classes)
        loss = float(_loss(state[0], x[held], y[held], classes))
        since += 1
        if loss < best:
            best, kept, since = loss, state[0], 0
        if since == PATIENCE:
            break
    return np.asarray(jax.nn.softmax(_logits(kept, jnp.asarray(test), classes)))


def _correlation(x: Floats, labels: NDArray, classes: int) -> Floats:
    """float32[d]: of each column the largest correlation, of either sign, with one class of one question."""
    right = np.eye(classes, dtype=np.float32)[labels].reshape(len(labels), -1)
    spread = x.std(axis=0)
    covariance = np.abs((right - right.mean(axis=0)).T @ (x - x.mean(axis=0))).max(axis=0)
    return covariance / np.where(spread > 0, spread, np.float32(1))


def _optimiser() -> optax.GradientTransformation:
    return optax.adamw(RATE, weight_decay=DECAY)


def _logits(params: list, x: jax.Array, classes: int) -> jax.Array:
    for kernel, bias in params[:-1]:
        x = jax.nn.relu(x @ kernel + bias)
    kernel, bias = params[-1]
    return (x @ kernel + bias).reshape(len(x), -1, classes)


@functools.partial(jax.jit, static_argnames="classes")
def _loss(params: list, x: jax.Array, y: jax.Array, classes: int) -> jax.Array:
    losses = optax.softmax_cross_entropy_with_integer_labels(_logits(params, x, classes), y)
    return jnp.mean(losses)


@functools.partial(jax.jit, static_argnames="classes")
def _epoch(state: Any, x: jax.Array, y: jax.Array, batches: jax.Array, classes: int) -> Any:
    def step(state, rows):
        params, moments = state
        gradient = jax.grad(_loss)(params, x[rows], y[rows], classes)
        with jax.numpy_dtype_promotion("standard"):  # optax raises a float to an integer
            update, moments = _optimiser().update(gradient, moments, params)
        return (optax.apply_updates(params, update), moments), None

    return jax.lax.scan(step, state, batches)[0]


def standard(train: Floats, test: Floats) -> tuple[Floats, Floats]:
    """Columns with the mean 0 and the spread 1 in training, the test's by the same scale."""
    mean, spread = train.mean(axis=0), train.std(axis=0)
    scale = 1 / np.where(spread > 0, spread, np.float32(1))
    return (train - mean) * scale, (test - mean) * scale


def numbers(train: Words, test: Words) -> tuple[Floats, Floats]:
    """Words as floats in [-1, 1), signed numbers relative to the first training row's; then `standard`.

    A difference modulo 2^64 leaves uniform words uniform, and brings together what one mask hides, whose
    values else lie apart by less than a float resolves.
    """
    return standard(_signed(train, train[0]), _signed(test, train[0]))


def _signed(words: Words, origin: Words) -> Floats:
    # float32 keeps 24 bits of a number however small it is.
    return ((words - origin).view(np.int64) * 2.0**-63).astype(np.float32)


def bits(train: Words, test: Words) -> tuple[Floats, Floats]:
    """The bits of uint64[n, w], -1 or 1: float32[n, 64 w]."""
    return _bits(train), _bits(test)


def _bits(words: Words) -> Floats:
    octets = np.ascontiguousarray(words).view(np.uint8)
    return 2 * np.unpackbits(octets, axis=1).astype(np.float32) - 1


def balanced(labels: NDArray[np.int64], seed: int) -> NDArray[np.int64]:
    """Indices of as many rows of class 0 as of class 1, all of the rarer one, in random order."""
    rng = np.random.default_rng(seed)
    classes = [rng.permutation(np.flatnonzero(labels == value)) for value in (0, 1)]
    count = min(map(len, classes))
    return rng.permutation(np.concatenate([rows[:count] for rows in classes]))


def score(hits: int, trials: int) -> dict[str, Any]:
    """Hits, trials, accuracy (%), and its 95 % interval (%) by Wilson's formula."""
    z, p = 1.959964, hits / trials
    middle = (p + z**2 / (2 * trials)) / (1 + z**2 / trials)
    half = z / (1 + z**2 / trials) * np.sqrt(p * (1 - p) / trials + z**2 / (4 * trials**2))
    interval = [round(float(100 * x), 2) for x in (middle - half, middle + half)]
    return {"hits": hits, "trials": trials, "accuracy": round(100 * p, 2), "interval": interval}


def recorded(
    path: Path, seed: int, configuration: dict[str, Any], measure: Callable[[], tuple[Any, dict[str, float]]]
) -> dict[str, Any]:
    """What `path` holds; measured and written there first, if it is not there.

    Args:
        path: NAME-SEED.json.
        seed: of everything random.
        configuration: all that decides the results.
        measure: gives the results, and the seconds of its parts by name.

    Returns:
        name, seed, configuration, versions, machine, at, seconds, results.

    Raises:
        ValueError: the file there is of another configuration.
    """
    if path.exists():
        document = read_json(path)
        if document.get("configuration") != configuration:
            raise ValueError(f"{path} is of another configuration; remove it, or choose another --results")
        return document
    began = time.perf_counter()
    results, seconds = measure()
    seconds["all"] = time.perf_counter() - began
    document = {
        "name": path.stem.rpartition("-")[0],
        "seed": seed,
        "configuration": configuration,
        "versions": provenance.versions(),
        "machine": provenance.machine(),
        "at": provenance.now(),
        "seconds": {name: round(value, 1) for name, value in seconds.items()},
        "results": results,
    }
    write_json(path, document)
    return document
