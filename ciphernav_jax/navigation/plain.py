"""Plaintext training, end to end: two encoders and the classifier (paper, section 5).

A batch holds whole environments, so that a camera's view serves every step of its environment;
views that occur more than once in a batch are encoded once.
"""

import functools
import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import optax
from flax import nnx
from numpy.typing import NDArray

from ciphernav_jax.learning.progress import Report
from ciphernav_jax.learning.storage import Checkpoint
from ciphernav_jax.models import Navigator
from ciphernav_jax.models.classifier import ACTIONS
from ciphernav_jax.models.encoders import VIEW_FEATURES
from ciphernav_jax.navigation.methods import Method
from ciphernav_jax.navigation.owners import CAMERAS
from ciphernav_jax.navigation.samples import Samples, training_samples
from ciphernav_jax.world.dataset import Dataset
from ciphernav_jax.world.grid import WALLS, map_code
from ciphernav_jax.world.poses import LANES

GRAPH = nnx.split(Navigator(nnx.Rngs(0)))[0]


@dataclass(frozen=True)
class EndToEnd:
    """How to train end to end: AdamW on a cosine with warm-up, gradients clipped to norm 1."""

    epochs: int = 24
    """Passes over the environments."""
    batch: int = 50
    """Environments per step."""
    learning_rate: float = 1.5e-3
    """Peak learning rate."""
    weight_decay: float = 0.01
    """AdamW's weight decay."""
    loss: Literal["cross-entropy", "squared"] = "cross-entropy"
    """Loss of a step's logits against the right action; the paper's is squared."""
    smoothing: float = 0.0
    """What the cross-entropy takes from the right action and spreads over all five, in [0, 1): with it a
    network stops growing once it is sure, and learns its training environments less by heart."""
    lanes: float = 0.0
    """Weight of a second loss, on what the view encoder sees: from the features of each camera a linear
    layer, which is thrown away afterwards, tells which of the four cells ahead in its lane hold an obstacle.
    The paper has none; with it the encoder keeps also what the training paths did not need."""
    errands: int = 0
    """Further paths in every environment to train on, to goals of the robot's own choice (the paper: 0)."""
    stray: float = 0.0
    """How often a robot on an errand takes any move instead of the right one."""

    def __post_init__(self):
        if not 0 <= self.smoothing < 1:
            raise ValueError(f"smoothing must lie in [0, 1), not at {self.smoothing}")
        if self.smoothing and self.loss != "cross-entropy":
            raise ValueError(f"only the cross-entropy is smoothed, not the {self.loss} loss")


def optimiser(recipe: EndToEnd, steps: int) -> optax.GradientTransformation:
    """The optimiser of a recipe over so many steps in all."""
    rate = optax.warmup_cosine_decay_schedule(0.0, recipe.learning_rate, steps // 20, steps)
    return optax.chain(optax.clip_by_global_norm(1.0), optax.adamw(rate, weight_decay=recipe.weight_decay))


def updated(params: Any, moments: Any, gradient: Any, recipe: EndToEnd, steps: int) -> tuple[Any, Any]:
    """The next weights and moments, by the optimiser of a recipe over so many steps in all."""
    with jax.numpy_dtype_promotion("standard"):  # optax raises a float to an integer
        update, moments = optimiser(recipe, steps).update(gradient, moments, params)
    return optax.apply_updates(params, update), moments


class Batch(NamedTuple):
    """The samples of some environments. Padding rows have action -1 and do not count.

    Attributes:
        pixels: uint8[U, 45, 60, 3], the distinct views of the batch; None if the method sees none.
        views: int32[S, 5], rows of `pixels` for the four cameras and the robot.
        maps: uint8[S, 25].
        actions: int32[S].
        occupied: float32[S, 4, 4], whether an obstacle stands in the cells ahead of each camera, 1 or 0.
    """

    pixels: NDArray[np.uint8] | None
    views: NDArray[np.int32]
    maps: NDArray[np.uint8]
    actions: NDArray[np.int32]
    occupied: NDArray[np.float32]


def batches(
    dataset: Dataset, method: Method, samples: Samples, recipe: EndToEnd, seed: int, epoch: int
) -> Iterator[Batch]:
    """One epoch's batches, in an order that depends on nothing but seed and epoch."""
    count = len(dataset)
    order = np.random.default_rng([seed, epoch]).permutation(count)
    first = np.searchsorted(samples.env, np.arange(count + 1))
    for start in range(0, count, recipe.batch):
        chosen = order[start : start + recipe.batch]
        rows = [
            np.arange(*ends) for ends in zip(first[chosen].tolist(), first[chosen + 1].tolist(), strict=True)
        ]
        yield _gather(dataset, method, samples, np.concatenate(rows))


def logits(navigator: Navigator, batch: Batch, method: Method) -> tuple[jax.Array, jax.Array]:
    """What a navigator that sees what `method` sees makes of a batch.

    Returns:
        The logits, float32[S, 5], and the features of the five views, float32[S, 5, 32].
    """
    place = navigator.map_encoder(jnp.asarray(batch.maps))
    shape = (len(batch.maps), len(CAMERAS) + 1, VIEW_FEATURES)
    views = jnp.zeros(shape, jnp.float32)
    if batch.pixels is not None:
        seen = np.array([method.cameras] * len(CAMERAS) + [method.agent_view])
        encoded = navigator.view_encoder(jnp.asarray(batch.pixels))[batch.views]
        views = jnp.where(seen[:, None], encoded, views)
    return navigator.classifier(jnp.concatenate([views.reshape(len(views), -1), place], axis=-1)), views


def train_navigator(
    dataset: Dataset, method: Method, recipe: EndToEnd, seed: int, checkpoint: Checkpoint, report: Report
) -> tuple[Navigator, list[dict]]:
    """Train a navigator, or go on from the latest checkpoint: the result is the same to the bit.

    Args:
        dataset: the training environments.
        method: what the navigator sees.
        recipe: how to train.
        seed: of the initial weights and of the batches' order.
        checkpoint: kept after the latest epoch.
        report: called after each epoch.

    Returns:
        The navigator, and the curve: a dict of epoch, mean loss, accuracy (%, teacher-forced, on the
        training samples as they were trained on) and seconds for each epoch.
    """
    samples = training_samples(dataset, method, seed, recipe.errands, recipe.stray)
    steps = recipe.epochs * -(-len(dataset) // recipe.batch)
    navigator = nnx.to_pure_dict(nnx.split(Navigator(nnx.Rngs(seed)), nnx.Param)[1])
    params = {"navigator": navigator, "lanes": _lane_layer()}
    fresh = (params, optimiser(recipe, steps).init(params))

    done, state, curve = checkpoint.restore(fresh)
    for epoch in range(done, recipe.epochs):
        began = time.perf_counter()
        total, hits = 0.0, 0
        for batch in batches(dataset, method, samples, recipe, seed, epoch):
            state, (loss, right) = _step(state, batch, method, recipe, steps)
            total, hits = total + float(loss), hits + int(right)
        point = {
            "epoch": epoch + 1,
            "loss": total / len(samples),
            "accuracy": 100 * hits / len(samples),
            "seconds": time.perf_counter() - began,
        }
        curve = [*curve, point]
        checkpoint.save(epoch + 1, state, curve)
        report(epoch + 1, recipe.epochs, point)
    return nnx.merge(GRAPH, state[0]["navigator"]), curve


@functools.partial(jax.jit, static_argnames=("method", "recipe", "steps"))
def _step(state: tuple, batch: Batch, method: Method, recipe: EndToEnd, steps: int):
    """One step: the next weights and moments, and the batch's summed loss and number of right actions."""

    def objective(params):
        scores, views = logits(nnx.merge(GRAPH, params["navigator"]), batch, method)
        counts = batch.actions >= 0
        right = jax.nn.one_hot(batch.actions, ACTIONS, dtype=jnp.float32)
        if recipe.loss == "squared":
            losses = jnp.mean(jnp.square(scores - right), axis=-1)
        else:
            losses = optax.softmax_cross_entropy(scores, optax.smooth_labels(right, recipe.smoothing))
        total = jnp.sum(losses, where=counts)
        hits = jnp.sum((jax.lax.argmax(scores, 1, jnp.int32) == batch.actions) & counts)
        seen = views[:, : len(CAMERAS)] @ params["lanes"]["kernel"] + params["lanes"]["bias"]
        unsure = jnp.mean(optax.sigmoid_binary_cross_entropy(seen, batch.occupied), axis=(1, 2))
        objective = total + jnp.float32(recipe.lanes) * jnp.sum(unsure, where=counts)
        return objective / jnp.sum(counts).astype(jnp.float32), (total, hits)

    params, moments = state
    (_, sums), gradient = jax.value_and_grad(objective, has_aux=True)(params)
    return updated(params, moments, gradient, recipe, steps), sums


def _gather(dataset: Dataset, method: Method, samples: Samples, rows: NDArray) -> Batch:
    env, cell, heading = samples.env[rows], samples.cell[rows], samples.heading[rows]
    cameras, robot = dataset.cameras[env], dataset.agent[env, cell, heading][:, None]
    seen = [robot] if method.agent_view else []
    seen = [cameras, robot] if method.cameras else seen
    pixels, views = None, np.zeros((len(rows), len(CAMERAS) + 1), np.int32)
    if seen:
        distinct, index = np.unique(np.concatenate(seen, axis=1), return_inverse=True)
        views[:, -sum(part.shape[1] for part in seen) :] = index.reshape(len(rows), -1)
        pixels = _pad(np.asarray(dataset.views[distinct]), 0)
    maps = map_code(WALLS[dataset.layout[env]], cell, samples.goal[rows])
    actions = samples.action[rows].astype(np.int32)
    occupied = np.asarray(dataset.obstacles)[env[:, None, None], LANES[:, 1:]].astype(np.float32)
    return Batch(pixels, _pad(views, 0), _pad(maps, 0), _pad(actions, -1), _pad(occupied, 0))


def _lane_layer() -> dict[str, NDArray[np.float32]]:
    cells = LANES.shape[1] - 1
    return {"kernel": np.zeros((VIEW_FEATURES, cells), np.float32), "bias": np.zeros(cells, np.float32)}


def _pad(rows: NDArray, value: int, multiple: int = 128) -> NDArray:
    # Few different shapes, so that a step is compiled few times.
    missing = -len(rows) % multiple
    return np.pad(rows, [(0, missing)] + [(0, 0)] * (rows.ndim - 1), constant_values=value)
