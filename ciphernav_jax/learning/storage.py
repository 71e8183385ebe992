"""Pytrees of arrays in files: a training's result, and its latest state."""

import hashlib
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import jax
import numpy as np

from ciphernav_jax.files import REMEDY, DamagedError, read_arrays, write_arrays
from ciphernav_jax.secret import is_secret


def save_tree(path: Path, tree: Any, of: str = "", **more: Any) -> None:
    """Write a pytree's leaves, of secrets the shares, and `more` arrays by name (`files.write_arrays`)."""
    leaves = enumerate(jax.tree.leaves(tree, is_leaf=is_secret))
    write_arrays(path, {str(index): np.asarray(_array(leaf)) for index, leaf in leaves} | more, of)


def load_tree(path: Path, like: Any, of: str = "", remedy: str = REMEDY) -> tuple[Any, dict[str, Any]]:
    """What `save_tree` wrote: the pytree, of numpy arrays, and the other arrays.

    The structure is not stored: it is that of `like`, whose leaves are arrays of the same shapes and dtypes.

    Raises:
        DamagedError: the file is missing, is not what was written, or holds other shapes than `like`.
    """
    stored = read_arrays(path, of, remedy)
    leaves, structure = jax.tree.flatten(like, is_leaf=is_secret)
    found = []
    for index, leaf in enumerate(leaves):
        array, expected = stored.pop(str(index), None), np.asarray(_array(leaf))
        if array is None or (array.shape, array.dtype) != (expected.shape, expected.dtype):
            raise DamagedError(f"{path} holds arrays of another version of this program; {remedy}")
        found.append(replace(leaf, shares=array) if is_secret(leaf) else array)
    return jax.tree.unflatten(structure, found), stored


def fingerprint(tree: Any) -> str:
    """The SHA-256 of a pytree's arrays, one after the other; of secrets, of their shares."""
    digest = hashlib.sha256()
    for leaf in jax.tree.leaves(tree, is_leaf=is_secret):
        digest.update(np.asarray(_array(leaf)).tobytes())
    return digest.hexdigest()


def _array(leaf: Any) -> Any:
    return leaf.shares if is_secret(leaf) else leaf


class Checkpoint:
    """The latest state of a training and its curve so far, in one file.

    A state is any pytree of arrays; a secret is stored as its shares. Its structure is not stored:
    `restore` takes it from a fresh state of the same training.

    Args:
        path: the file.
        of: what decides the training; that of another one is refused.
    """

    def __init__(self, path: Path, of: str = ""):
        self._path, self._of = path, of

    def also(self, of: str) -> "Checkpoint":
        """The same file, of a training that this decides, too."""
        return Checkpoint(self._path, self._of + of)

    def save(self, step: int, state: Any, curve: list[dict]) -> None:
        """Replace the checkpoint; killed at any moment, there is the old one or the new one."""
        text = np.frombuffer(json.dumps(curve).encode(), np.uint8)
        save_tree(self._path, state, self._of, step=np.int64(step), curve=text)

    def restore(self, fresh: Any) -> tuple[int, Any, list[dict]]:
        """The latest step, state and curve; step 0, the fresh state and no curve where nothing is stored.

        Raises:
            DamagedError: the file is not what was written, or holds other shapes than `fresh`.
        """
        if not self._path.exists():
            return 0, fresh, []
        remedy = (
            f"remove {self._path.parent} and train anew, or name another file if it is another training's"
        )
        state, more = load_tree(self._path, fresh, self._of, remedy)
        return int(more["step"]), state, json.loads(more["curve"].tobytes())
