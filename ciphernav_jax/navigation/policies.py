"""Trained classifiers as policies: what is computed at each step of an episode."""

from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ciphernav_jax.navigation.classifier import predict
from ciphernav_jax.navigation.features import Features
from ciphernav_jax.navigation.parties import CAMERAS, SLOTS
from ciphernav_jax.navigation.rollout import Policy
from ciphernav_jax.protocols import Protocol
from ciphernav_jax.secret import reveal, secure, share


def plain_policy(params: Any, features: Features) -> Policy:
    """Take the action with the largest logit. `features` are those of the environments driven in."""
    every = np.arange(len(features.goal))
    decide = jax.jit(best_action)

    def policy(step, cells, headings):
        return np.asarray(decide(params, features.slots(every, cells, headings)))

    return policy


def secret_policy(
    params: Any, features: Features, key: jax.Array, parties: int, protocol: Protocol | None = None
) -> Policy:
    """The same under secret sharing, with secret or public weights.

    The camera owners share their features once, since an environment does not change; the robot shares
    its view's and its map's at each step. Opened: the best action alone; or, where `protocol.opened` says so,
    the logits, as in the paper.
    """
    protocol = protocol or Protocol()
    sharing = partial(share, parties=parties, protocol=protocol)
    every = np.arange(len(features.goal))
    result = predict if protocol.opened == "logits" else best_action
    decide = jax.jit(secure(result, protocol=protocol))
    cameras = tuple(
        sharing(jax.random.fold_in(key, SLOTS.index(name)), slot)
        for name, slot in zip(CAMERAS, features.cameras, strict=True)
    )
    robot_key, protocol_key = (jax.random.fold_in(key, len(SLOTS) + use) for use in range(2))

    def policy(step, cells, headings):
        robot = features.robot(every, cells, headings, features.goal)
        shared = sharing(jax.random.fold_in(robot_key, step), robot)
        opened = np.asarray(
            reveal(decide(jax.random.fold_in(protocol_key, step), params, (*cameras, *shared)))
        )
        return opened if protocol.opened == "argmax" else np.argmax(opened, axis=-1)

    return policy


def best_action(params: Any, slots: tuple) -> jax.Array:
    """int32[n]: the action with the largest logit, the first of equals."""
    return jnp.argmax(predict(params, slots), axis=-1).astype(jnp.int32)
