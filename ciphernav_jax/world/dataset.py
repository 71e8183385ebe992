"""The data set on disk: plain `.npy` arrays, memory-mapped when read, and `meta.json`.

Loading needs neither MiniWorld nor OpenGL nor JAX; generating starts processes that have them.
"""

import errno
import hashlib
import importlib.metadata
import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    ProgressColumn,
    Task,
    TextColumn,
    TimeRemainingColumn,
)
from rich.text import Text

from ciphernav_jax import files
from ciphernav_jax.command_line import SEED, WORKERS
from ciphernav_jax.files import DamagedError
from ciphernav_jax.world.grid import CELLS, HEADINGS, MAX_ACTIONS, WALLS
from ciphernav_jax.world.journal import Journal, partial_folder
from ciphernav_jax.world.poses import CAMERAS, IMAGE_SHAPE, POSES
from ciphernav_jax.world.scenario import MAX_OBSTACLES, Obstacle, Scenario, key
from ciphernav_jax.world.shards import BACKGROUNDS, Request, draw_shards

FORMAT = "ciphernav_jax Obstacle World, version 1"
SPLITS = ("train", "test", "validation")

# Every array's dtype and the shape of one row; `views` has its own number of rows.
_ARRAYS: dict[str, tuple[str, tuple[int, ...]]] = {
    "views": ("uint8", IMAGE_SHAPE),
    "cameras": ("int32", (len(CAMERAS),)),
    "agent": ("int32", (CELLS, len(HEADINGS))),
    "layout": ("uint8", ()),
    "obstacles": ("bool", (CELLS,)),
    "start_heading": ("uint8", ()),
    "goal": ("uint8", ()),
    "actions": ("int8", (MAX_ACTIONS,)),
    "detour": ("bool", ()),
    "obstacle_cell": ("int8", (MAX_OBSTACLES,)),
    "obstacle_shape": ("int8", (MAX_OBSTACLES,)),
    "obstacle_colour": ("int8", (MAX_OBSTACLES,)),
    "obstacle_position": ("float64", (MAX_OBSTACLES, 2)),
    "obstacle_yaw": ("float64", (MAX_OBSTACLES,)),
}


_META = {"split", "count", "seed", "unseen_by", "versions", "gl", "files"}

MOST = (2**31 - 1) // POSES
"""Environments: views are numbered by int32, at most 104 of an environment's own."""
# Of an environment on disk, at the least: its views that are no other's, and the record of it.
_BYTES = 60_000


@dataclass(frozen=True)
class Dataset:
    """N environments of Obstacle World with all their views, as read-only memory-mapped arrays.

    Attributes:
        views: uint8[V, 45, 60, 3], every distinct image once.
        cameras: int32[N, 4], the fixed cameras' views as indices into `views`, in the order
            bottom_left, bottom_right, top_left, top_right.
        agent: int32[N, 25, 4], the agent's view by cell and heading; -1 where the cell is a wall
            or holds an obstacle.
        layout: uint8[N], 0..11, see `grid.LAYOUTS`.
        obstacles: bool[N, 25], the cells that hold an obstacle.
        start_heading: uint8[N], 3 (east) or 1 (south).
        goal: uint8[N], a cell.
        actions: int8[N, 17], the shortest path's moves, a final 0, and -1 after it.
        detour: bool[N], whether the obstacles change the shortest path.
        obstacle_cell: int8[N, 3], the cell of each obstacle; -1 for none, as in the next two.
        obstacle_shape: int8[N, 3], index into `scenario.SHAPES`.
        obstacle_colour: int8[N, 3], index into `scenario.COLOURS`; a cone ignores it.
        obstacle_position: float64[N, 3, 2], x (east) and z (south) in metres.
        obstacle_yaw: float64[N, 3], in radians.
        meta: the content of `meta.json`.
    """

    views: NDArray[np.uint8]
    cameras: NDArray[np.int32]
    agent: NDArray[np.int32]
    layout: NDArray[np.uint8]
    obstacles: NDArray[np.bool_]
    start_heading: NDArray[np.uint8]
    goal: NDArray[np.uint8]
    actions: NDArray[np.int8]
    detour: NDArray[np.bool_]
    obstacle_cell: NDArray[np.int8]
    obstacle_shape: NDArray[np.int8]
    obstacle_colour: NDArray[np.int8]
    obstacle_position: NDArray[np.float64]
    obstacle_yaw: NDArray[np.float64]
    meta: dict[str, Any]

    def __repr__(self) -> str:
        split = self.meta.get("split", "made by hand")
        return f"Dataset({split}: {len(self):,} environments, {len(self.views):,} views)"

    def __len__(self) -> int:
        return len(self.layout)

    @property
    def walls(self) -> NDArray[np.bool_]:
        """bool[N, 25]: the walls of every environment."""
        return WALLS[self.layout]

    def scenario(self, index: int) -> Scenario:
        """Environment `index` as a scenario, for `ObstacleWorld` and the renderer."""
        obstacles = tuple(
            Obstacle(int(cell), int(shape), int(colour), float(x), float(z), float(yaw))
            for cell, shape, colour, (x, z), yaw in zip(
                self.obstacle_cell[index],
                self.obstacle_shape[index],
                self.obstacle_colour[index],
                self.obstacle_position[index],
                self.obstacle_yaw[index],
                strict=True,
            )
            if cell >= 0
        )
        return Scenario(
            int(self.layout[index]), int(self.start_heading[index]), int(self.goal[index]), obstacles
        )

    def pairs(self) -> frozenset[tuple[int, int]]:
        """The (layout, obstacle cells) pairs that occur, see `Scenario.key`."""
        return frozenset(map(key, self.layout, self.obstacles))


def load(folder: str | Path, *, verify: bool = True) -> Dataset:
    """Opens a data set.

    Sizes, dtypes and shapes are always checked. Checksums cost about a second per gigabyte.

    Args:
        folder: written by `generate`.
        verify: whether to compare every file with its checksum.

    Raises:
        FileNotFoundError: when the folder has no `meta.json`.
        DamagedError: when a file is foreign, missing, truncated or damaged; it is named.
    """
    folder = Path(folder)
    meta = _read_meta(folder)
    arrays = {}
    with files.fitting(folder / "meta.json", _remedy(folder)):
        for name in _ARRAYS:
            arrays[name] = _read_array(folder, name, meta, verify)
    return Dataset(**arrays, meta=meta)


def generate(
    split: str,
    count: int,
    seed: int,
    out: str | Path,
    *,
    workers: int = 2,
    unseen_by: str | Path | Request | None = None,
    progress: bool = True,
) -> Dataset:
    """Draws and renders `count` environments, half of which need a detour.

    Killed at any moment and called again, it goes on where it was; the bytes depend neither on
    that nor on `workers`. When `out` already holds what is asked for, nothing is done.

    Args:
        split: "train", "test" or "validation"; with the same seed they are independent draws.
        count: number of environments.
        seed: at least 0.
        out: the folder to write; until it is complete, `<out>.partial` is used.
        workers: rendering processes.
        unseen_by: a data set's folder, or the request that it would be made by, which need not have
            been rendered; no pair of layout and obstacle cells in it comes up. The draw is
            independent of the one without this option.
        progress: whether to show a progress bar.

    Raises:
        ValueError: for an unknown split, or a count, seed or number of workers out of range.
        FileExistsError: when `out`, or what is left of an earlier run, holds something else.
        DamagedError: when a file of `out`, or of what is left of an earlier run, is damaged.
        BusyError: when another process is generating `out`.
        GLUnavailable: when OpenGL is missing; the message lists the packages to install.
        RuntimeError: when a rendering process dies.
    """
    if split not in SPLITS:
        raise ValueError(f"split={split!r} is not one of {SPLITS}.")
    for name, value, (least, most) in (
        ("count", count, (1, MOST)),
        ("seed", seed, SEED),
        ("workers", workers, WORKERS),
    ):
        if not least <= value <= most:
            raise ValueError(f"{name}={value} must lie in {least}..{most}.")
    out = Path(out).absolute()
    seen = Seen() if unseen_by is None else _seen(unseen_by)
    request = Request(split, count, seed, seen.pairs)
    meta = {
        "format": FORMAT,
        "split": split,
        "count": count,
        "seed": seed,
        "unseen_by": seen.fingerprint,
        "versions": {
            p: importlib.metadata.version(p) for p in ("ciphernav_jax", "miniworld", "pyglet", "numpy")
        },
    }
    if _holds(out, meta):
        return load(out)
    if not partial_folder(out).exists():
        _require_room(out, count)
    with files.claimed(partial_folder(out)):
        if not _holds(out, meta):  # nobody has made it meanwhile
            journal = Journal(out, meta)
            numbers = range(BACKGROUNDS, request.shards)[journal.shards :]
            with _progress_bar(progress) as bar:
                task = bar.add_task(f"Rendering {split}", total=count, completed=journal.environments)
                for shard in draw_shards(request, numbers, workers):
                    journal.add(shard)
                    bar.update(task, completed=journal.environments)
            journal.finish(meta)
        else:
            shutil.rmtree(partial_folder(out))
    return load(out, verify=False)


def _require_room(out: Path, environments: int) -> None:
    """Raises an `OSError` where the disk has no room for so many environments."""
    there = next(folder for folder in out.parents if folder.exists())
    free, needed = shutil.disk_usage(there).free, environments * _BYTES
    if needed > free:
        said = f"{environments:,} environments need at least {needed / 1e9:,.1f} GB"
        raise OSError(errno.ENOSPC, f"{said}, and {free / 1e9:,.1f} GB are free", str(out))


class _Rate(ProgressColumn):
    """Environments per second."""

    def render(self, task: Task) -> Text:
        return Text(f"{task.speed:.0f} environments/s" if task.speed else "")


def _progress_bar(shown: bool) -> Progress:
    return Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        _Rate(),
        TextColumn("remaining"),
        TimeRemainingColumn(),
        speed_estimate_period=120.0,  # shards arrive seconds apart
        disable=not shown,
    )


class Seen(NamedTuple):
    """What must not come up: pairs, see `Scenario.key`, and a SHA-256 of the files that say them."""

    pairs: frozenset[tuple[int, int]] = frozenset()
    fingerprint: str | None = None


def _seen(by: str | Path | Request) -> Seen:
    names = ("layout", "obstacles")
    if isinstance(by, Request):
        digests = [hashlib.sha256(files.npy(by.columns[name])).hexdigest() for name in names]
        return Seen(by.pairs(), "-".join(digests))
    described = _read_meta(Path(by))["files"]
    return Seen(load(by).pairs(), "-".join(described[f"{name}.npy"]["sha256"] for name in names))


def _holds(folder: Path, meta: dict[str, Any]) -> bool:
    """Whether the folder is the data set made for a request like `meta`; false if it is empty or not there.

    Raises:
        FileExistsError: when it holds something else.
    """
    if not folder.exists() or (folder.is_dir() and not any(folder.iterdir())):
        return False
    if (folder / "meta.json").exists() and meta.items() <= _read_meta(folder).items():
        return True
    raise FileExistsError(
        f"{folder} holds something else than what is asked for; remove it or choose another."
    )


def _read_meta(folder: Path) -> dict[str, Any]:
    path = folder / "meta.json"
    if not path.is_file():
        raise FileNotFoundError(
            f"{path} is missing: {folder} is no data set; make one with `ciphernav generate`."
        )
    meta = files.read_json(path, remedy=_remedy(folder))
    if meta.get("format") != FORMAT or not meta.keys() >= _META:
        raise DamagedError(f"{path} does not describe a data set of the format {FORMAT!r}; {_remedy(folder)}")
    return meta


def _read_array(folder: Path, name: str, meta: dict[str, Any], verify: bool) -> NDArray:
    path = folder / f"{name}.npy"
    stated = meta["files"][path.name]
    if not path.is_file():
        raise DamagedError(f"{path} is missing; {_remedy(folder)}")
    if path.stat().st_size != stated["bytes"]:
        raise DamagedError(
            f"{path} is {path.stat().st_size} bytes long instead of {stated['bytes']}: truncated or foreign; "
            + _remedy(folder)
        )
    if verify and files.describe(path) != stated:
        raise DamagedError(f"{path} is damaged: its SHA-256 is not the one in meta.json; {_remedy(folder)}")
    try:
        array = np.load(path, mmap_mode="r")
    except ValueError as error:
        raise DamagedError(f"{path} is no NumPy array: {error}; {_remedy(folder)}") from error
    dtype, row = _ARRAYS[name]
    rows = len(array) if name == "views" and array.ndim else meta["count"]
    if array.dtype != dtype or array.shape != (rows, *row):
        raise DamagedError(
            f"{path} holds {array.dtype}{list(array.shape)} instead of {dtype}{[rows, *row]}: foreign file; "
            + _remedy(folder)
        )
    return array


def _remedy(folder: Path) -> str:
    return f"remove {folder} and make it anew with `ciphernav generate`"
