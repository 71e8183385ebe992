"""Training folders: how a training is begun, finished, and read back.

config.json     what is trained, how, and on what; a folder goes on only with the same
checkpoint.npz  the latest state of the training
model.npz       the result, once it is finished: encoders, scales and weights (of a secret, shares)
curve.json      the training curve; it is written last, so that a folder that has it is finished

Of a robot's sight, `model.npz` holds the weights alone. All are checked when they are read (`files`): a file
of another training does not pass for this one's, and one that is missing is not replaced.
"""

from dataclasses import asdict
from pathlib import Path
from typing import Any, NamedTuple

import jax
from flax import nnx

from ciphernav_jax import __version__, files
from ciphernav_jax.files import DamagedError
from ciphernav_jax.learning.storage import Checkpoint, load_tree, save_tree
from ciphernav_jax.models import Navigator
from ciphernav_jax.navigation import features
from ciphernav_jax.navigation.classifier import FreshClassifier
from ciphernav_jax.navigation.features import Features, Scale
from ciphernav_jax.navigation.methods import METHODS, Method
from ciphernav_jax.navigation.plain import EndToEnd
from ciphernav_jax.navigation.sight import Looking
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

    def encode(self, dataset: Dataset, method: Method) -> Features:
        """What every owner makes of a data set with these encoders; not standardised yet."""
        navigator = Navigator(nnx.Rngs(0))
        nnx.update(navigator.view_encoder, self.encoders["view_encoder"])
        nnx.update(navigator.map_encoder, self.encoders["map_encoder"])
        return features.encode(dataset, method, navigator.view_encoder, navigator.map_encoder)


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
    return config, result(folder, config, like)


def curve(folder: Path) -> list[dict]:
    """The training curve of a finished training."""
    of = files.canonical(_read_config(folder))
    return files.read_json(folder / "curve.json", of, _remedy(folder))["points"]


def sees(config: dict) -> Method:
    """What a training's robot sees: the methods on frozen features see what `plaintext` sees."""
    return METHODS.get(config["method"], METHODS["plaintext"])


def row(config: dict, parties: int | None = None) -> str:
    """The name of a training's row in the table, driven as in `driving.drive`."""
    if config["parties"]:
        return f"secret-{config['parties']}"
    return f"{config['method']}, public weights, {parties} parties" if parties else config["method"]


def configuration(
    method: str,
    parties: int | None,
    seed: int,
    recipe: EndToEnd | FreshClassifier | Looking,
    dataset: Dataset,
) -> dict:
    """All that decides what is trained: config.json."""
    data = {name: dataset.meta.get(name) for name in ("split", "count", "seed", "unseen_by")}
    training = {"method": method, "parties": parties, "seed": seed, "recipe": asdict(recipe), "data": data}
    return {"kind": KIND, "version": __version__, **training}


def key_of(seed: int, what: str, how: dict, dataset: Dataset) -> jax.Array:
    """The key of one use of one data set. All that decides which values are hidden is part of its purpose:
    two trainings, or two drives, that differ in anything have no mask in common.
    """
    return keys.derive(keys.root(seed), what, files.canonical(how), files.canonical(dataset.meta))


def begin(folder: Path, config: dict) -> bool:
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


def checkpoint(folder: Path, config: dict) -> Checkpoint:
    """Of the training that the folder holds."""
    return Checkpoint(folder / "checkpoint.npz", files.canonical(config))


def result(folder: Path, config: dict, like: Any) -> Any:
    """What the folder's finished training left, of the structure of `like`."""
    return load_tree(folder / "model.npz", like, files.canonical(config), _remedy(folder))[0]


def finish(folder: Path, config: dict, found: Any, curve: list[dict]) -> Any:
    """Write what was trained, and its curve last."""
    of = files.canonical(config)
    save_tree(folder / "model.npz", found, of)
    files.write_json(folder / "curve.json", {"points": curve}, of)
    return found


def _remedy(folder: Path) -> str:
    return f"remove {folder} and train anew"


def _template(config: dict) -> Trained:
    parts = nnx.to_pure_dict(nnx.state(Navigator(nnx.Rngs(0)), nnx.Param))
    weights = parts.pop("classifier")
    if parties := config["parties"]:
        key, protocol = keys.derive(keys.root(0), "template"), Protocol(**config["protocol"])
        weights = share(key, weights, parties=parties, protocol=protocol)
    return Trained(parts, features.unscaled(), weights)
