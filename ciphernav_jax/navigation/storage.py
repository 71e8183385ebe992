"""Files that are whole or absent: JSON written aside and renamed, and orbax checkpoints."""

import json
import logging
import os
from pathlib import Path
from typing import Any

import jax
import numpy as np
import orbax.checkpoint as ocp


class DamagedError(ValueError):
    """A file or folder that cannot be what it should be; the message names it and the way out."""


def write_text(path: Path, text: str) -> None:
    """Write a file aside and rename it, so that a kill leaves the old file or the new one."""
    path.parent.mkdir(parents=True, exist_ok=True)
    aside = path.with_name(path.name + ".part")
    aside.write_text(text)
    os.replace(aside, path)


def write_json(path: Path, value: Any) -> None:
    """Write JSON as `write_text` does."""
    write_text(path, json.dumps(value, indent=2) + "\n")


def read_json(path: Path) -> Any:
    """Read JSON.

    Raises:
        DamagedError: the file is absent or is not JSON.
    """
    try:
        return json.loads(path.read_text())
    except FileNotFoundError:
        raise DamagedError(f"{path} is missing: is {path.parent} the folder you mean?") from None
    except ValueError as error:
        raise DamagedError(f"{path} is damaged ({error}); remove {path.parent} and make it anew") from None


class Checkpoints:
    """The latest state of a training and its curve so far, in an orbax folder.

    A state is any pytree of arrays; a secret is stored as its shares. Its structure is not stored:
    `restore` takes it from a fresh state of the same training.
    """

    def __init__(self, folder: Path):
        logging.getLogger("absl").setLevel(logging.ERROR)
        options = ocp.CheckpointManagerOptions(max_to_keep=1, enable_async_checkpointing=False)
        self._folder = folder
        self._manager = ocp.CheckpointManager(folder.absolute(), options=options)

    def save(self, step: int, state: Any, curve: list[dict]) -> None:
        """Replace the checkpoint; killed at any moment, the folder holds the old one or the new one."""
        leaves = {str(index): leaf for index, leaf in enumerate(jax.tree.leaves(state))}
        items = {"state": ocp.args.StandardSave(leaves), "curve": ocp.args.JsonSave(curve)}  # pyright: ignore
        self._manager.save(step, args=ocp.args.Composite(**items))

    def restore(self, fresh: Any) -> tuple[int, Any, list[dict]]:
        """The latest step, state and curve; step 0, the fresh state and no curve where nothing is stored.

        Raises:
            DamagedError: the checkpoint cannot be read, or holds other shapes than `fresh`.
        """
        step = self._manager.latest_step()
        if step is None:
            return 0, fresh, []
        leaves, structure = jax.tree.flatten(fresh)
        like = {str(index): ocp.utils.to_shape_dtype_struct(leaf) for index, leaf in enumerate(leaves)}
        items = {"state": ocp.args.StandardRestore(like), "curve": ocp.args.JsonRestore()}  # pyright: ignore
        try:
            stored = self._manager.restore(step, args=ocp.args.Composite(**items))
        except Exception as error:  # orbax has no common class for what can be wrong with a file
            raise DamagedError(
                f"checkpoint {self._folder / str(step)} cannot be read ({type(error).__name__}); "
                f"remove {self._folder.parent} and train anew"
            ) from error
        # numpy, as orbax pins its arrays to a device, and a training step would be compiled again for that.
        restored = [np.asarray(stored["state"][str(index)]) for index in range(len(leaves))]
        return step, jax.tree.unflatten(structure, restored), stored["curve"]
