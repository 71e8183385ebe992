"""Driving with what a training left."""

from dataclasses import asdict, replace
from typing import Any

import jax
import numpy as np
from numpy.typing import NDArray

from ciphernav_jax.learning.storage import fingerprint
from ciphernav_jax.navigation import features, sight
from ciphernav_jax.navigation.folders import Trained, key_of, sees
from ciphernav_jax.navigation.owners import cast
from ciphernav_jax.navigation.policies import plain_policy, secret_policy
from ciphernav_jax.navigation.rollout import Careful, Episodes, Policy, rollout
from ciphernav_jax.navigation.samples import start_headings
from ciphernav_jax.protocols import Protocol
from ciphernav_jax.world.dataset import Dataset


def drive(
    dataset: Dataset,
    config: dict,
    trained: Trained,
    seed: int,
    parties: int | None = None,
    *,
    protocol: Protocol | None = None,
    eyes: Any = None,
) -> Episodes:
    """Let a trained classifier drive in every environment; a secret one under secret sharing.

    Args:
        dataset: the environments.
        config, trained: of the training, as `folders.load` gives them.
        seed: of the shares and of the dealer.
        parties: lets a classifier that was trained in plaintext drive under secret sharing: its weights are
            public, the inputs and what is computed from them secret (the paper's section 3).
        protocol: of such a drive; a secret classifier drives by the one that it was trained with.
        eyes: weights of a `Sight`; robots that have them use what they alone know (`rollout.Careful`).

    Raises:
        ValueError: fewer than two parties, or others than the ones that share the weights; a protocol for
            a secret classifier, or for a drive in the clear.
    """
    if parties is not None:
        cast(parties)
        if config["parties"] not in (None, parties):
            raise ValueError(
                f"{config['parties']} parties share these weights, not {parties}; leave --parties out"
            )
    if config["parties"]:
        if protocol:
            raise ValueError("a secret training drives by the protocol that it was trained with")
        parties, protocol = config["parties"], Protocol(**config["protocol"])
    if protocol and not parties:
        raise ValueError("a variant of the protocol is for drives under secret sharing; say --parties too")
    seen = features.standardise(trained.encode(dataset, sees(config)), trained.scales)
    if parties:
        key = driving_key(dataset, config, trained, seed, parties, protocol, eyes)
        policy = secret_policy(trained.weights, seen, key, parties, protocol)
    else:
        policy = plain_policy(trained.weights, seen)
    headings = start_headings(dataset, sees(config))
    if eyes is None:
        return rollout(dataset, policy, headings)
    return drive_carefully(dataset, policy, headings, eyes)


def drive_carefully(dataset: Dataset, policy: Policy, headings: NDArray[np.int64], eyes: Any) -> Episodes:
    """The episodes of robots with eyes, which use what they alone know (`rollout.Careful`)."""
    robots = Careful(policy, dataset, sight.obstacles_in_sight(dataset, eyes))
    return replace(rollout(dataset, robots, headings), alone=robots.alone)


def driving_key(
    dataset: Dataset,
    config: dict,
    trained: Trained,
    seed: int,
    parties: int,
    protocol: Protocol | None = None,
    eyes: Any = None,
) -> jax.Array:
    """The key of a drive; the arguments are those of `drive`."""
    how = {"parties": parties, "protocol": asdict(protocol or Protocol()), "model": config}
    how |= {"weights": fingerprint(trained.weights), "eyes": eyes and fingerprint(eyes)}
    return key_of(seed, "driving", how, dataset)
