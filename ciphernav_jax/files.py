"""Files that are whole or absent, and folders that one process writes to at a time.

A file is written aside and renamed: killed at any moment there is the old one or the new one. JSON and
arrays carry a SHA-256 of what they hold, of their name and of what they belong to (`of`). So a flipped bit, a
file of another kind and one of another run are found when they are read, before anything in them is used.
"""

import fcntl
import hashlib
import io
import json
import os
import zipfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

DIGEST = "sha256"
REMEDY = "remove it and make it anew"


class DamagedError(ValueError):
    """A file or folder that is not what was written; the message names it and the way out."""


class BusyError(RuntimeError):
    """A folder that another process is writing to; the message names it."""


@contextmanager
def naming(path: Path) -> Iterator[None]:
    """Gives an `OSError` that names no file, such as that of a full disk, the name of this one."""
    try:
        yield
    except OSError as error:
        if error.filename is None:
            error.filename = str(path)
        raise


@contextmanager
def fitting(path: Path, remedy: str = REMEDY) -> Iterator[None]:
    """Names a file that is what was written, but by a version of this program that wrote another shape."""
    try:
        yield
    except DamagedError:
        raise
    except (LookupError, TypeError, AttributeError, ArithmeticError, ValueError) as error:
        raise DamagedError(
            f"{path} is not of the shape that this version reads ({type(error).__name__}: {error}); {remedy}"
        ) from error


@contextmanager
def claimed(folder: Path) -> Iterator[None]:
    """Keeps a folder, made if it is not there, from all other processes that would write to it.

    The lock is the kernel's and ends with the process, however that ends. It leaves no file behind.

    Raises:
        BusyError: another process has the folder.
    """
    descriptor = _locked(folder)
    try:
        yield
    finally:
        os.close(descriptor)


def _locked(folder: Path) -> int:
    while True:
        folder.mkdir(parents=True, exist_ok=True)
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            with naming(folder):
                fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if os.path.samestat(os.fstat(descriptor), os.stat(folder)):
                return descriptor
        except BlockingIOError:
            os.close(descriptor)
            raise BusyError(
                f"another process is writing to {folder}; wait for it, or choose another folder"
            ) from None
        except FileNotFoundError:
            pass  # whoever had it has removed it meanwhile
        os.close(descriptor)


def write_bytes(path: Path, data: bytes) -> None:
    """Write a file aside and rename it."""
    path.parent.mkdir(parents=True, exist_ok=True)
    aside = path.with_name(path.name + ".part")
    with naming(path), open(aside, "wb") as file:
        file.write(data)
        file.flush()
        os.fsync(file.fileno())
    os.replace(aside, path)


def write_png(path: Path, figure: Any, *, dpi: int) -> None:
    """A figure of matplotlib's, whole or not at all."""
    file = io.BytesIO()
    figure.savefig(file, format="png", dpi=dpi)
    write_bytes(path, file.getvalue())


def write_text(path: Path, text: str) -> None:
    """Write a text as `write_bytes` does."""
    write_bytes(path, text.encode())


def read_text(path: Path) -> str:
    """Read a text.

    Raises:
        DamagedError: it is not UTF-8.
    """
    try:
        with naming(path):
            return path.read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        raise DamagedError(f"{path} is no text: {error}") from None


def write_json(path: Path, value: Mapping[str, Any], of: str = "") -> None:
    """Write a JSON object as `write_bytes` does, with its digest as the last entry.

    Args:
        path: the file.
        value: what to write; without an entry "sha256".
        of: what it belongs to; `read_json` must be told the same.
    """
    sealed = {**value, DIGEST: _digest_of_json(path, of, value)}
    write_text(path, json.dumps(sealed, indent=2) + "\n")


def read_json(path: Path, of: str = "", remedy: str = REMEDY) -> dict[str, Any]:
    """Read what `write_json` wrote, without the digest.

    Args:
        path, of: as given to `write_json`.
        remedy: the way out, for the message.

    Raises:
        DamagedError: the file is missing, or is not what was written.
    """
    stored = _read(path, remedy)
    try:
        value = json.loads(stored)
        digest = value.pop(DIGEST)
    except (ValueError, RecursionError, KeyError, TypeError, AttributeError):
        raise DamagedError(f"{path} is damaged, or none of our files; {remedy}") from None
    if digest != _digest_of_json(path, of, value):
        raise _damaged(path, remedy)
    return value


def write_arrays(path: Path, arrays: Mapping[str, Any], of: str = "") -> None:
    """Write an `.npz` file; the archive's comment, its last 64 bytes, is the digest of all before it."""
    buffer = io.BytesIO()
    np.savez(buffer, **arrays)
    with zipfile.ZipFile(buffer, "a") as archive:
        archive.comment = bytes(2 * hashlib.sha256().digest_size)
    data = buffer.getvalue()[: -len(archive.comment)]
    write_bytes(path, data + _digest(path, of, data).encode())


def read_arrays(path: Path, of: str = "", remedy: str = REMEDY) -> dict[str, NDArray]:
    """Read what `write_arrays` wrote.

    Args:
        path, of: as given to `write_arrays`.
        remedy: the way out, for the message.

    Raises:
        DamagedError: the file is missing, or is not what was written.
    """
    stored = _read(path, remedy)
    size = 2 * hashlib.sha256().digest_size
    if stored[-size:] != _digest(path, of, stored[:-size]).encode():
        raise _damaged(path, remedy)
    with np.load(io.BytesIO(stored), allow_pickle=False) as arrays:
        return dict(arrays)


def describe(file: Path) -> dict[str, Any]:
    """A file's size in bytes and its SHA-256, for a file that stands beside it."""
    with open(file, "rb") as content:
        digest = hashlib.file_digest(content, "sha256").hexdigest()
    return {"bytes": file.stat().st_size, DIGEST: digest}


def npy(array: NDArray) -> bytes:
    """An array as a file `.npy` holds it."""
    content = io.BytesIO()
    np.save(content, array)
    return content.getvalue()


def canonical(value: Any) -> str:
    """The same text for the same JSON: fit to say what a file belongs to."""
    return json.dumps(json.loads(json.dumps(value)), sort_keys=True)


def _read(path: Path, remedy: str) -> bytes:
    try:
        with naming(path):
            return path.read_bytes()
    except FileNotFoundError:
        raise DamagedError(f"{path} is missing; {remedy}") from None


def _damaged(path: Path, remedy: str) -> DamagedError:
    return DamagedError(f"{path} is not what was written there (by its SHA-256); {remedy}")


def _digest_of_json(path: Path, of: str, value: Any) -> str:
    return _digest(path, of, canonical(value).encode())


def _digest(path: Path, of: str, content: bytes) -> str:
    digest = hashlib.sha256(json.dumps([path.name, of]).encode())
    digest.update(content)
    return digest.hexdigest()
