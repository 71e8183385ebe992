"""Trained classifiers as policies: what is computed at each step of an episode."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ciphernav_jax.navigation.classifier import predict
from ciphernav_jax.navigation.features import Features
from ciphernav_jax.navigation.owners import CAMERAS
from ciphernav_jax.navigation.rollout import Policy
from ciphernav_jax.protocols import Protocol
from ciphernav_jax.ring import keys
from ciphernav_jax.secret import Secret, reveal, secure, share


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
    """The same under secret sharing, with secret or public weights. `key` is for one drive of one data set.

    The camera owners share their features once, since an environment does not change; the robot shares
    its view's and its map's at each step. Opened: the best action alone; or, where `protocol.opened` says so,
    the logits, as in the paper.
    """
    protocol = protocol or Protocol()
    every = np.arange(len(features.goal))
    result = predict if protocol.opened == "logits" else best_action
    decide = jax.jit(secure(result, protocol=protocol))
    cameras = share_cameras(key, features, parties, protocol)

    def policy(step, cells, headings):
        robot = features.robot(every, cells, headings, features.goal)
        shared = share_robot(key, step, robot, parties, protocol)
        opened = np.asarray(reveal(decide(decision_key(key, step), params, (*cameras, *shared))))
        return opened if protocol.opened == "argmax" else np.argmax(opened, axis=-1)

    return policy


def share_cameras(
    key: jax.Array, features: Features, parties: int, protocol: Protocol | None = None
) -> tuple[Secret, ...]:
    """What the camera owners share before the first step of the drive that has this key."""
    return tuple(
        share(keys.derive(key, "slot", name), slot, parties=parties, protocol=protocol)
        for name, slot in zip(CAMERAS, features.cameras, strict=True)
    )


def share_robot(
    key: jax.Array, step: int, robot: tuple, parties: int, protocol: Protocol | None = None
) -> tuple[Secret, ...]:
    """What the robot shares at a step."""
    return share(keys.derive(key, "robot", step), robot, parties=parties, protocol=protocol)


def decision_key(key: jax.Array, step: int) -> jax.Array:
    """The key of the decisions at a step."""
    return keys.derive(key, "decision", step)


def best_action(params: Any, slots: tuple) -> jax.Array:
    """int32[n]: the action with the largest logit, the first of equals."""
    return jnp.argmax(predict(params, slots), axis=-1).astype(jnp.int32)
