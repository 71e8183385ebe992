"""What a robot sees for itself: its `Sight` trained, and applied to its own views.

The robot's views are its own, so all of this is in plaintext and nobody else has a part in it.
"""

import functools
import time
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import optax
from flax import nnx
from numpy.typing import NDArray

from ciphernav_jax.learning.progress import Report
from ciphernav_jax.learning.storage import Checkpoint
from ciphernav_jax.models import Sight
from ciphernav_jax.models.sight import REACH
from ciphernav_jax.navigation import features
from ciphernav_jax.navigation.plain import EndToEnd, optimiser, updated
from ciphernav_jax.world.dataset import Dataset
from ciphernav_jax.world.grid import CELLS, RAYS, WALLS

GRAPH = nnx.split(Sight(nnx.Rngs(0)))[0]


@dataclass(frozen=True)
class Looking:
    """How to train a sight: as the encoders are, on views drawn at random."""

    steps: int = 1200
    """Steps, a batch each."""
    batch: int = 500
    """Views per step: from any free cell, in any direction but towards a wall or off the grid."""
    chunk: int = 100
    """Steps between checkpoints."""


def initial(seed: int) -> dict:
    """Random weights, as a dict of float32 arrays."""
    return nnx.to_pure_dict(nnx.split(Sight(nnx.Rngs(seed)))[1])


def train_eyes(
    dataset: Dataset, recipe: Looking, seed: int, checkpoint: Checkpoint, report: Report
) -> tuple[dict, list[dict]]:
    """Train a sight, or go on from the latest checkpoint: the same to the bit.

    Args:
        dataset: the training environments.
        recipe: how to train.
        seed: of the weights and of the views' order.
        checkpoint: kept after the latest chunk of steps.
        report: called after each chunk.

    Returns:
        The weights, and the curve: for each chunk a dict of step, mean loss (cross-entropy), accuracy in
        percent of the cells ahead, on the views as they were trained on, and seconds.
    """
    views, obstacle = _examples(dataset)
    weights = initial(seed)
    done, state, curve = checkpoint.restore((weights, optimiser(EndToEnd(), recipe.steps).init(weights)))
    while done < recipe.steps:
        began = time.perf_counter()
        total, right = 0.0, 0
        last = min(done + recipe.chunk, recipe.steps)
        for step in range(done, last):
            rows = np.random.default_rng([seed, step]).integers(0, len(views), recipe.batch)
            pixels = np.asarray(dataset.views[views[rows]])
            state, (loss, hits) = _step(state, pixels, obstacle[rows], recipe)
            total, right = total + float(loss), right + int(hits)
        count = last - done
        done = last
        point = {
            "step": done,
            "loss": total / count,
            "accuracy": 100 * right / (count * recipe.batch * REACH),
            "seconds": time.perf_counter() - began,
        }
        curve = [*curve, point]
        checkpoint.save(done, state, curve)
        report(done, recipe.steps, point)
    return state[0], curve


def obstacles_in_sight(dataset: Dataset, weights: Any) -> NDArray[np.bool_]:
    """bool[N, 25, 25]: the cells (last axis) in which a robot that looks around from a cell sees an obstacle.

    False where it cannot stand, and for whatever is not straight ahead of it in one of the four directions,
    with nothing of its map's walls between.
    """
    agent = np.asarray(dataset.agent)
    logits = features.of_views(nnx.merge(GRAPH, weights), dataset.views)
    found = (logits[agent] > 0) & (agent >= 0)[..., None] & _open(dataset)
    seen = np.zeros((len(agent), CELLS, CELLS), bool)
    cell, heading, step = np.nonzero(RAYS >= 0)
    seen[:, cell, RAYS[cell, heading, step]] = found[:, cell, heading, step]
    return seen


def _open(dataset: Dataset) -> NDArray[np.bool_]:
    """bool[N, 25, 4, 4]: which of the cells straight ahead are in the grid, and not in or behind a wall."""
    wall = (RAYS < 0) | WALLS[:, RAYS]
    return ~np.logical_or.accumulate(wall, axis=-1)[dataset.layout]


def _examples(dataset: Dataset) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """The numbers of the views that a robot can have, but of a wall, and bool[V, 4]: the nearest obstacle.

    What that hides it need not guess.
    """
    agent, ahead = np.asarray(dataset.agent), _open(dataset)
    env, cell, heading = np.nonzero((agent >= 0) & ahead[..., 0])
    obstacle = np.asarray(dataset.obstacles)[env[:, None], RAYS[cell, heading]] & ahead[env, cell, heading]
    nearest = obstacle & (np.cumsum(obstacle, axis=1) == 1)
    return agent[env, cell, heading].astype(np.int64), nearest


@functools.partial(jax.jit, static_argnames="recipe")
def _step(state: tuple, pixels: jax.Array, obstacle: jax.Array, recipe: Looking):
    """One step: the next weights and moments, and the batch's mean loss and number of right answers."""

    def objective(weights):
        logits = nnx.merge(GRAPH, weights)(pixels)
        losses = optax.sigmoid_binary_cross_entropy(logits, obstacle.astype(jnp.float32))
        return jnp.mean(losses), jnp.sum((logits > 0) == obstacle)

    weights, moments = state
    (loss, hits), gradient = jax.value_and_grad(objective, has_aux=True)(weights)
    return updated(weights, moments, gradient, EndToEnd(), recipe.steps), (loss, hits)
