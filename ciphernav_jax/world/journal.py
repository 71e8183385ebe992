"""Writing a data set shard by shard, so that a run killed at any moment resumes to the same bytes.

Everything happens in the folder `<out>.partial`. Images are appended to `data/views.npy` there,
and a small record per shard then says how far that file is valid, with a digest of what was
appended. At the end the records become arrays, `meta.json` is written, and one rename turns `data`
into `<out>`, which is therefore either absent or complete.
"""

import hashlib
import itertools
import os
import shutil
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from ciphernav_jax import files
from ciphernav_jax.files import DamagedError
from ciphernav_jax.world.grid import CELLS, HEADINGS, WALLS
from ciphernav_jax.world.poses import CAMERAS, IMAGE_SHAPE, POSES
from ciphernav_jax.world.shards import Shard

_VIEW_BYTES = int(np.prod(IMAGE_SHAPE))


def partial_folder(out: Path) -> Path:
    """Where a data set is kept until it is complete."""
    out = out.absolute()
    return out.with_name(out.name + ".partial")


class Journal:
    """A data set being written to `out`, which must not exist yet.

    Args:
        out: the folder to be; who writes has claimed its partial folder (`files.claimed`).
        request: JSON object of all that decides the bytes. A partial folder is resumed only if it
            was begun for an equal one.

    Raises:
        FileExistsError: when the partial folder belongs to another request.
        DamagedError: when a file in it is not what was written.
    """

    def __init__(self, out: Path, request: dict[str, Any]):
        self._out = out
        self._folder = partial_folder(out)
        self._data = self._folder / "data"
        self._data.mkdir(parents=True, exist_ok=True)
        self._remedy = f"remove {self._folder} and run the same command again"
        self._request = files.canonical(request)
        self._begin(request)
        self._records = self._read_records()
        self._views, self._number_of = self._open_views()

    @property
    def shards(self) -> int:
        """How many shards are safely written, the backgrounds included."""
        return len(self._records)

    @property
    def environments(self) -> int:
        """How many environments are safely written."""
        return sum(len(record["cameras"]) for record in self._records[1:])

    @property
    def views(self) -> int:
        """How many distinct images are safely written."""
        return len(self._number_of)

    def add(self, shard: Shard) -> None:
        """Appends the next shard; the first one is the backgrounds.

        Raises:
            RuntimeError: when another OpenGL renderer drew it than the ones before.
        """
        if self._records and shard.gl != (begun := str(self._records[0]["gl"])):
            raise RuntimeError(
                f"{self._folder} was begun with the OpenGL renderer {begun!r}, this is {shard.gl!r}; "
                "remove the folder to start afresh."
            )
        appended = hashlib.sha256()
        with files.naming(self._data / "views.npy"):
            numbers = [self._store(view, appended) for view in shard.views]
            self._views.flush()
            os.fsync(self._views.fileno())
        # Index -1, no view, picks the -1 at the end and stays what it is.
        backgrounds = self._records[0]["backgrounds"] if self._records else np.full(len(WALLS) * POSES, -1)
        view_of = np.concatenate([backgrounds, numbers, [-1]]).astype(np.int32)[shard.view_of]
        record = {"gl": np.array(shard.gl), "views": np.array(self.views), **shard.columns}
        record["appended"] = np.array(appended.hexdigest())
        if self._records:
            record["cameras"] = view_of[:, : len(CAMERAS)]
            record["agent"] = view_of[:, len(CAMERAS) :].reshape(-1, CELLS, len(HEADINGS))
        else:
            record["backgrounds"] = view_of.reshape(-1)
        files.write_arrays(self._record(self.shards), record, self._request)
        self._records.append(record)

    def finish(self, meta: dict[str, Any]) -> None:
        """Writes the arrays and `meta.json` (`meta`, the GL renderer, every file's description),
        and moves the data to its place."""
        with files.naming(self._data / "views.npy"):
            _write_header(self._views, self.views)
            self._views.close()
        names = [name for name in self._records[1] if name not in ("gl", "views", "appended")]
        for name in names:
            column = files.npy(np.concatenate([r[name] for r in self._records[1:]]))
            files.write_bytes(self._data / f"{name}.npy", column)
        described = {f"{name}.npy": files.describe(self._data / f"{name}.npy") for name in ("views", *names)}
        meta = {**meta, "gl": str(self._records[0]["gl"]), "files": described}
        files.write_json(self._data / "meta.json", meta)
        os.replace(self._data, self._out)
        shutil.rmtree(self._folder)

    def _record(self, number: int) -> Path:
        return self._folder / f"record-{number:05d}.npz"

    def _begin(self, request: dict[str, Any]) -> None:
        """Begins the partial folder, or makes sure that it was begun for the same request."""
        path = self._folder / "request.json"
        if not path.exists():
            files.write_json(path, request)
        if files.canonical(files.read_json(path, remedy=self._remedy)) != self._request:
            raise FileExistsError(
                f"{self._folder} was begun for another request or with other versions (see {path.name}); "
                "remove that folder to start afresh."
            )

    def _read_records(self) -> list[dict[str, NDArray]]:
        """The records, up to the last one that is there with all before it, and with all its images."""
        views = self._data / "views.npy"
        stored = views.stat().st_size // _VIEW_BYTES if views.exists() else 0  # the header is shorter
        records = []
        for path in map(self._record, itertools.count()):
            if not path.exists():
                break
            record = files.read_arrays(path, self._request, self._remedy)
            if record["views"] > stored:
                break
            records.append(record)
        return records

    def _open_views(self) -> tuple[BinaryIO, dict[bytes, int]]:
        """The file of images, cut back to what the records vouch for, and their numbers by digest.

        Raises:
            DamagedError: when the images are not those that were appended.
        """
        path = self._data / "views.npy"
        if not path.exists():
            path.unlink(missing_ok=True)  # a link to nowhere
            path.touch()
        file = open(path, "r+b")  # noqa: SIM115 - stays open from shard to shard
        header = _write_header(file, 0)
        file.truncate(header + _VIEW_BYTES * (int(self._records[-1]["views"]) if self._records else 0))
        number_of = {}
        for record in self._records:
            appended = hashlib.sha256()
            for number in range(len(number_of), int(record["views"])):
                view = file.read(_VIEW_BYTES)
                number_of[_digest(view)] = number
                appended.update(view)
            if appended.hexdigest() != str(record["appended"]):
                raise DamagedError(f"{path} is not what was written there (by its SHA-256); {self._remedy}")
        return file, number_of

    def _store(self, view: NDArray[np.uint8], appended: Any) -> int:
        """The number of an image, which is appended, and to a hash, unless an identical one is there."""
        data = view.tobytes()
        digest = _digest(data)
        if digest not in self._number_of:
            self._number_of[digest] = self.views
            self._views.write(data)
            appended.update(data)
        return self._number_of[digest]


def _digest(view: bytes) -> bytes:
    return hashlib.blake2b(view, digest_size=16).digest()


def _write_header(file: BinaryIO, count: int) -> int:
    """Writes the header of `count` images over the old one, for NumPy leaves room for the first
    axis to grow; returns its length."""
    file.seek(0)
    header = {"descr": "|u1", "fortran_order": False, "shape": (count, *IMAGE_SHAPE)}
    np.lib.format.write_array_header_1_0(file, header)
    return file.tell()
