"""A fresh action classifier on frozen features: what `learning` is given of Obstacle World."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from flax import nnx

from ciphernav_jax.learning import Column, Model, Sgd, SplitTable
from ciphernav_jax.learning.fitting import at_start
from ciphernav_jax.learning.sgd import sgd_step
from ciphernav_jax.models import ActionClassifier
from ciphernav_jax.models.classifier import ACTIONS
from ciphernav_jax.models.encoders import MAP_FEATURES, VIEW_FEATURES
from ciphernav_jax.navigation.features import Features
from ciphernav_jax.navigation.owners import CAMERAS, SLOTS, cast
from ciphernav_jax.navigation.samples import Samples

GRAPH = nnx.split(ActionClassifier(nnx.Rngs(0)))[0]


@dataclass(frozen=True)
class FreshClassifier(Sgd):
    """How to train the classifier, and on what."""

    standardised: bool = True
    """Whether each owner standardises the features of its slots before it shares them."""
    errands: int = 0
    """Further paths in every environment to train on, to goals of the robot's own choice (the paper: 0)."""
    stray: float = 0.0
    """How often a robot on an errand takes any move instead of the right one."""


def predict(weights: Any, slots: tuple) -> jax.Array:
    """The five logits, float32[n, 5], from the six slots of the input, float32[n, 32 or 128]."""
    return nnx.merge(GRAPH, weights)(jnp.concatenate(slots, axis=-1))


CLASSIFIER = Model(predict, ACTIONS)


def initial(seed: int) -> dict:
    """Random public weights of a fresh classifier, as a dict of float32 arrays."""
    return nnx.to_pure_dict(nnx.split(ActionClassifier(nnx.Rngs(seed)))[1])


def training_step(recipe: FreshClassifier, seed: int = 0) -> tuple[Callable[..., Any], tuple[Any, ...]]:
    """A step of a training, and a batch of random features and labels to look at it by.

    Returns:
        `step(state, slots, labels, decay)`, which is `sgd_step` with this recipe; and these arguments, all to
        be shared but `decay`.
    """
    generator = np.random.default_rng(seed)
    weights = initial(seed)
    widths = (MAP_FEATURES if slot == "map" else VIEW_FEATURES for slot in SLOTS)
    slots = tuple(generator.standard_normal((recipe.batch, width)).astype(np.float32) for width in widths)
    labels = np.eye(ACTIONS, dtype=np.float32)[generator.integers(ACTIONS, size=recipe.batch)]
    state = (*at_start(weights), np.float32(0))
    return partial(sgd_step, CLASSIFIER, recipe=recipe), (state, slots, labels, np.float32(1))


def table(features: Features, samples: Samples, parties: int | None = None) -> SplitTable:
    """The six slots of every sample, and the right actions, one-hot; with those who hold them (`cast`)."""
    robot = features.robot(samples.env, samples.cell, samples.heading, samples.goal)
    values = dict(zip(SLOTS, (*features.cameras, *robot), strict=True))
    rows: dict[str, Any] = dict.fromkeys(CAMERAS, samples.env)  # a camera's view is its environment's
    owners = {slot: party.name for party in cast(parties or 2) for slot in party.slots}
    labels = np.eye(ACTIONS, dtype=np.float32)[samples.action]
    return SplitTable(
        {slot: Column(owners[slot], values[slot], rows.get(slot)) for slot in SLOTS},
        answers=Column(owners["agent"], labels),
    )
