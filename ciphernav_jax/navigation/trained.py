"""Training folders: how a training is begun, gone on with after a kill, finished, and read back.

config.json     what is trained, how, and on what; a folder goes on only with the same
checkpoint.npz  the latest state of the training
model.npz       the result, once it is finished: encoders, scales and weights (of a secret, shares)
curve.json      the training curve; it is written last, so that a folder that has it is finished

Of a robot's sight, `model.npz` holds the weights alone. All are checked when they are read (`files`): a file
of another training does not pass for this one's, and one that is missing is not replaced.
"""

import hashlib
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, NamedTuple

import jax
import numpy as np
from flax import nnx
from numpy.typing import NDArray

from ciphernav_jax import __version__, files
from ciphernav_jax.files import DamagedError
from ciphernav_jax.models import Navigator
from ciphernav_jax.navigation import classifier, features, plain, sight
from ciphernav_jax.navigation.classifier import FreshClassifier
from ciphernav_jax.navigation.features import Features, Scale
from ciphernav_jax.navigation.methods import METHODS, Method
from ciphernav_jax.navigation.parties import cast
from ciphernav_jax.navigation.plain import EndToEnd, Report
from ciphernav_jax.navigation.policies import plain_policy, secret_policy
from ciphernav_jax.navigation.rollout import Careful, Episodes, Policy, rollout
from ciphernav_jax.navigation.samples import start_headings, training_samples
from ciphernav_jax.navigation.sight import Looking
from ciphernav_jax.navigation.storage import Checkpoint, load_tree, save_tree
from ciphernav_jax.protocols import Protocol
from ciphernav_jax.ring import keys
from ciphernav_jax.secret import share
from ciphernav_jax.world.dataset import Dataset

KIND = "ciphernav training"


class Trained(NamedTuple):
    """What a training leaves.

    Attributes:
        encoders: weights of the view encoder and of the map encoder; public.
        scales: how each slot is standardised by its owner.
        weights: the action classifier's, float32 arrays or secrets.
    """

    encoders: Any
    scales: tuple[Scale, ...]
    weights: Any


def train_end_to_end(
    dataset: Dataset, name: str, recipe: EndToEnd, seed: int, folder: Path, report: Report
) -> Trained:
    """Train encoders and classifier of the method `name` in plaintext, in a training folder.

    Going on after a kill, and asking for what is there already, give the same bits.

    Raises:
        DamagedError: the folder holds another training, or a damaged one.
        BusyError: another process trains in the folder.
    """
    config = _config(name, None, seed, recipe, dataset)
    with files.claimed(folder):
        if _begin(folder, config):
            return load(folder)[1]
        navigator, curve = plain.train(
            dataset, METHODS[name], recipe, seed, _checkpoint(folder, config), report
        )
        parts = nnx.to_pure_dict(nnx.state(navigator, nnx.Param))
        weights = parts.pop("classifier")
        return _finish(folder, config, Trained(parts, features.unscaled(), weights), curve)


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
    config = _config(name, parties, seed, recipe, dataset) | {"encoders": fingerprint(teacher.encoders)}
    if parties is not None:
        config["protocol"] = asdict(protocol or Protocol())
    samples = training_samples(dataset, sees(config), seed, recipe.errands, recipe.stray)
    if recipe.batch > len(samples):
        raise ValueError(
            f"a batch of {recipe.batch:,} is more than the {len(samples):,} samples that the data set gives; "
            "choose a smaller --batch, or a larger data set"
        )
    with files.claimed(folder):
        if _begin(folder, config):
            return load(folder)[1]
        seen = encode(dataset, sees(config), teacher)
        scales = features.fit_scales(seen, samples) if recipe.standardised else features.unscaled()
        weights, curve = classifier.train(
            features.standardise(seen, scales),
            samples,
            recipe,
            seed,
            training_key(config, dataset),
            _checkpoint(folder, config),
            report,
            parties,
            protocol,
        )
        return _finish(folder, config, Trained(teacher.encoders, scales, weights), curve)


def train_sight(dataset: Dataset, recipe: Looking, seed: int, folder: Path, report: Report) -> Any:
    """Train what a robot sees for itself (`navigation.sight`), in a training folder.

    Returns:
        The weights. Going on after a kill, and asking for what is there already, give the same bits.

    Raises:
        DamagedError: the folder holds another training, or a damaged one.
        BusyError: another process trains in the folder.
    """
    config = _config("sight", None, seed, recipe, dataset)
    with files.claimed(folder):
        if _begin(folder, config):
            return _result(folder, config, sight.initial(0))
        weights, curve = sight.train(dataset, recipe, seed, _checkpoint(folder, config), report)
        return _finish(folder, config, weights, curve)


def load(folder: Path) -> tuple[dict, Trained]:
    """The configuration and the result of a finished training.

    Raises:
        DamagedError: the folder is not a training folder, is not finished, or is damaged.
    """
    config = _read_config(folder)
    if not (folder / "curve.json").exists():
        raise DamagedError(
            f"the training in {folder} is not finished; the same `ciphernav train` goes on with it"
        )
    curve(folder)
    with files.fitting(folder / "config.json", _remedy(folder)):
        like = _template(config)
    return config, _result(folder, config, like)


def curve(folder: Path) -> list[dict]:
    """The training curve of a finished training."""
    of = files.canonical(_read_config(folder))
    return files.read_json(folder / "curve.json", of, _remedy(folder))["points"]


def sees(config: dict) -> Method:
    """What a training's robot sees: the methods on frozen features see what `plaintext` sees."""
    return METHODS.get(config["method"], METHODS["plaintext"])


def row(config: dict, parties: int | None = None) -> str:
    """The name of a training's row in the table, driven as in `drive`."""
    if config["parties"]:
        return f"secret-{config['parties']}"
    return f"{config['method']}, public weights, {parties} parties" if parties else config["method"]


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
        config, trained: of the training, as `load` gives them.
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
    seen = features.standardise(encode(dataset, sees(config), trained), trained.scales)
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


def encode(dataset: Dataset, method: Method, trained: Trained) -> Features:
    navigator = Navigator(nnx.Rngs(0))
    nnx.update(navigator.view_encoder, trained.encoders["view_encoder"])
    nnx.update(navigator.map_encoder, trained.encoders["map_encoder"])
    return features.encode(dataset, method, navigator.view_encoder, navigator.map_encoder)


def _config(
    method: str,
    parties: int | None,
    seed: int,
    recipe: EndToEnd | FreshClassifier | Looking,
    dataset: Dataset,
) -> dict:
    data = {name: dataset.meta.get(name) for name in ("split", "count", "seed", "unseen_by")}
    training = {"method": method, "parties": parties, "seed": seed, "recipe": asdict(recipe), "data": data}
    return {"kind": KIND, "version": __version__, **training}


def training_key(config: dict, dataset: Dataset) -> jax.Array:
    """The key of a training, as its folder's configuration says it, on a data set."""
    return _key(config["seed"], "training", config, dataset)


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
    return _key(seed, "driving", how, dataset)


def _key(seed: int, what: str, how: dict, dataset: Dataset) -> jax.Array:
    """The key of one use of one data set. All that decides which values are hidden is part of its purpose:
    two trainings, or two drives, that differ in anything have no mask in common.
    """
    return keys.derive(keys.root(seed), what, files.canonical(how), files.canonical(dataset.meta))


def fingerprint(arrays: Any) -> str:
    """The SHA-256 of a pytree's arrays, one after the other."""
    digest = hashlib.sha256()
    for leaf in jax.tree.leaves(arrays):
        digest.update(np.asarray(leaf).tobytes())
    return digest.hexdigest()


def _begin(folder: Path, config: dict) -> bool:
    """Claim a folder for a training; true if it is finished already."""
    if (folder / "config.json").exists():
        there = _read_config(folder)
        if there != config:
            other = [name for name in config if there.get(name) != config[name]]
            raise DamagedError(
                f"{folder} holds another training (it differs in {', '.join(other)}); choose another --out"
            )
        return (folder / "curve.json").exists()
    files.write_json(folder / "config.json", config)
    return False


def _read_config(folder: Path) -> dict:
    if not (folder / "config.json").exists():
        raise DamagedError(f"{folder} holds no training: its config.json is missing; name another folder")
    config = files.read_json(folder / "config.json", remedy=_remedy(folder))
    if config.get("kind") != KIND:
        raise DamagedError(f"{folder} holds no training: its config.json says something else")
    return config


def _checkpoint(folder: Path, config: dict) -> Checkpoint:
    return Checkpoint(folder / "checkpoint.npz", files.canonical(config))


def _result(folder: Path, config: dict, like: Any) -> Any:
    return load_tree(folder / "model.npz", like, files.canonical(config), _remedy(folder))[0]


def _finish(folder: Path, config: dict, result: Any, curve: list[dict]) -> Any:
    of = files.canonical(config)
    save_tree(folder / "model.npz", result, of)
    files.write_json(folder / "curve.json", {"points": curve}, of)
    return result


def _remedy(folder: Path) -> str:
    return f"remove {folder} and train anew"


def _template(config: dict) -> Trained:
    parts = nnx.to_pure_dict(nnx.state(Navigator(nnx.Rngs(0)), nnx.Param))
    weights = parts.pop("classifier")
    if parties := config["parties"]:
        key, protocol = keys.derive(keys.root(0), "template"), Protocol(**config["protocol"])
        weights = share(key, weights, parties=parties, protocol=protocol)
    return Trained(parts, features.unscaled(), weights)
