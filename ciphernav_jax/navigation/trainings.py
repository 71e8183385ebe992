"""Trainings in their folders (`folders`): gone on with after a kill, and never done twice."""

from dataclasses import asdict
from pathlib import Path
from typing import Any

import jax
from flax import nnx

from ciphernav_jax import files
from ciphernav_jax.learning import fit
from ciphernav_jax.learning.fitting import require_batch
from ciphernav_jax.learning.progress import Report
from ciphernav_jax.learning.storage import fingerprint
from ciphernav_jax.navigation import classifier, features, folders, plain, sight
from ciphernav_jax.navigation.classifier import CLASSIFIER, FreshClassifier
from ciphernav_jax.navigation.folders import Trained
from ciphernav_jax.navigation.methods import METHODS
from ciphernav_jax.navigation.owners import cast
from ciphernav_jax.navigation.plain import EndToEnd
from ciphernav_jax.navigation.samples import training_samples
from ciphernav_jax.navigation.sight import Looking
from ciphernav_jax.protocols import Protocol
from ciphernav_jax.world.dataset import Dataset


def train_end_to_end(
    dataset: Dataset, name: str, recipe: EndToEnd, seed: int, folder: Path, report: Report
) -> Trained:
    """Train encoders and classifier of the method `name` in plaintext, in a training folder.

    Going on after a kill, and asking for what is there already, give the same bits.

    Raises:
        DamagedError: the folder holds another training, or a damaged one.
        BusyError: another process trains in the folder.
    """
    config = folders.configuration(name, None, seed, recipe, dataset)
    with files.claimed(folder):
        if folders.begin(folder, config):
            return folders.load(folder)[1]
        navigator, curve = plain.train_navigator(
            dataset, METHODS[name], recipe, seed, folders.checkpoint(folder, config), report
        )
        parts = nnx.to_pure_dict(nnx.state(navigator, nnx.Param))
        weights = parts.pop("classifier")
        return folders.finish(folder, config, Trained(parts, features.unscaled(), weights), curve)


def train_classifier(
    dataset: Dataset,
    teacher: Trained,
    recipe: FreshClassifier,
    seed: int,
    folder: Path,
    report: Report,
    parties: int | None = None,
    protocol: Protocol | None = None,
) -> Trained:
    """Train a fresh classifier on the features of `teacher`'s encoders, in a training folder.

    Args:
        dataset: the training environments.
        teacher: a plaintext training with camera views; only its encoders are used.
        recipe: how to train.
        seed: of everything random.
        folder: the training folder.
        report: called after each chunk of steps.
        parties: how many share the secrets; None trains in plaintext.
        protocol: the variants; None for the default. It decides how robots drive, too.

    Raises:
        ValueError: fewer than two parties, or a batch of more samples than there are.
        DamagedError: the folder holds another training, or a damaged one.
        BusyError: another process trains in the folder.
    """
    if parties is not None:
        cast(parties)
    name = "plaintext-classifier" if parties is None else "secret"
    config = folders.configuration(name, parties, seed, recipe, dataset) | {
        "encoders": fingerprint(teacher.encoders)
    }
    if parties is not None:
        config["protocol"] = asdict(protocol or Protocol())
    samples = training_samples(dataset, folders.sees(config), seed, recipe.errands, recipe.stray)
    require_batch(recipe, samples)
    with files.claimed(folder):
        if folders.begin(folder, config):
            return folders.load(folder)[1]
        seen = teacher.encode(dataset, folders.sees(config))
        scales = features.fit_scales(seen, samples) if recipe.standardised else features.unscaled()
        table = classifier.table(features.standardise(seen, scales), samples, parties)
        weights, curve = fit(
            CLASSIFIER,
            classifier.initial(seed),
            table,
            recipe,
            training_key(config, dataset),
            seed=seed,
            parties=parties,
            protocol=protocol,
            checkpoint=folders.checkpoint(folder, config),
            report=report,
        )
        return folders.finish(folder, config, Trained(teacher.encoders, scales, weights), curve)


def train_sight(dataset: Dataset, recipe: Looking, seed: int, folder: Path, report: Report) -> Any:
    """Train what a robot sees for itself (`navigation.sight`), in a training folder.

    Returns:
        The weights. Going on after a kill, and asking for what is there already, give the same bits.

    Raises:
        DamagedError: the folder holds another training, or a damaged one.
        BusyError: another process trains in the folder.
    """
    config = folders.configuration("sight", None, seed, recipe, dataset)
    with files.claimed(folder):
        if folders.begin(folder, config):
            return folders.result(folder, config, sight.initial(0))
        weights, curve = sight.train_eyes(dataset, recipe, seed, folders.checkpoint(folder, config), report)
        return folders.finish(folder, config, weights, curve)


def training_key(config: dict, dataset: Dataset) -> jax.Array:
    """The key of a training, as its folder's configuration says it, on a data set."""
    return folders.key_of(config["seed"], "training", config, dataset)
