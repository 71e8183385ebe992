"""Files that are whole or absent and are what was written; folders that one process writes to."""

import json
import os
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest

from ciphernav_jax import files
from ciphernav_jax.files import BusyError, DamagedError

ARRAYS = {"weights": np.arange(6, dtype=np.float32).reshape(2, 3), "shares": np.array([2**64 - 1], np.uint64)}
VALUE = {"name": "träining", "numbers": [1, 2.5, float("inf")], "by length": {"7": None}}


def json_file(path, of=""):
    files.write_json(path, VALUE, of)
    return files.read_json


def array_file(path, of=""):
    files.write_arrays(path, ARRAYS, of)
    return files.read_arrays


def test_what_is_read_is_what_was_written(tmp_path):
    read = json_file(tmp_path / "new" / "a.json")
    assert read(tmp_path / "new" / "a.json") == VALUE
    read = array_file(tmp_path / "a.npz", "a training")
    found = read(tmp_path / "a.npz", "a training")
    for name, array in ARRAYS.items():
        np.testing.assert_array_equal(found[name], array)
        assert found[name].dtype == array.dtype
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.npz", "new"]


def test_the_digest_stands_where_other_programs_leave_it_alone(tmp_path):
    json_file(tmp_path / "a.json")
    assert json.loads((tmp_path / "a.json").read_text()).keys() - VALUE.keys() == {"sha256"}
    array_file(tmp_path / "a.npz")
    with np.load(tmp_path / "a.npz") as arrays:
        assert set(arrays) == set(ARRAYS)


@pytest.mark.parametrize("write", [json_file, array_file])
def test_no_flipped_bit_passes(tmp_path, write):
    path = tmp_path / "a"
    read = write(path)
    original = path.read_bytes()
    expected = repr(read(path))
    for place in range(len(original)):
        changed = bytearray(original)
        changed[place] ^= 1 << place % 8
        path.write_bytes(changed)
        with suppress(DamagedError):
            assert repr(read(path)) == expected  # white space between JSON's words


@pytest.mark.parametrize("write", [json_file, array_file])
def test_what_is_not_the_file_is_refused_by_name_with_the_way_out(tmp_path, write):
    path = tmp_path / "a"
    read = write(path, "this training")
    content = path.read_bytes()
    write(other := tmp_path / "b", "this training")
    write(foreign := tmp_path / "c" / "a", "another training")
    harmed = {
        "cut": content[: len(content) // 2],
        "empty": b"",
        "longer": content + b"more",
        "another file's": other.read_bytes(),
        "another training's": foreign.read_bytes(),
        "no object": b"[1]\n",
        "without a digest": b"{}\n",
        "deep": b"[" * 100_000,
    }
    for bytes_ in harmed.values():
        path.write_bytes(bytes_)
        with pytest.raises(DamagedError, match=rf"{path}.*; burn it"):
            read(path, "this training", "burn it")
    path.unlink()
    with pytest.raises(DamagedError, match=rf"{path} is missing; burn it"):
        read(path, "this training", "burn it")


def test_numbers_as_keys_and_tuples_are_read_as_json_has_them(tmp_path):
    files.write_json(tmp_path / "a", {1: (2, 3)})
    assert files.read_json(tmp_path / "a") == {"1": [2, 3]}


def test_a_full_disk_names_the_file(tmp_path):
    with (
        pytest.raises(OSError, match="/somewhere"),
        files.naming("/somewhere"),
        open("/dev/full", "wb") as full,
    ):
        full.write(b"1")


def test_a_file_of_another_shape_is_named():
    shape = r"/a is not of the shape .*KeyError: 'seed'.*; burn it"
    with pytest.raises(DamagedError, match=shape), files.fitting(Path("/a"), "burn it"):
        {}["seed"]
    with pytest.raises(DamagedError, match="/b is missing"), files.fitting(Path("/a")):
        files.read_json(Path("/b"))


CLAIM = """
import sys
from contextlib import suppress
from pathlib import Path
from pathlib import Path
from ciphernav_jax import files
try:
    with files.claimed(Path(sys.argv[1])):
        print("mine")
except files.BusyError as error:
    print(error)
"""


def claimed_by_another(folder):
    said = subprocess.run([sys.executable, "-c", CLAIM, folder], capture_output=True, text=True, check=True)
    return said.stdout.strip()


def test_a_folder_has_one_writer(tmp_path):
    folder = tmp_path / "a" / "b"
    with files.claimed(folder):
        assert claimed_by_another(folder).startswith(f"another process is writing to {folder};")
        assert claimed_by_another(tmp_path) == "mine"
        with pytest.raises(BusyError), files.claimed(folder):
            pass
    assert claimed_by_another(folder) == "mine"
    assert os.listdir(folder) == []


def test_a_folder_that_its_writer_removes_is_made_again(tmp_path, monkeypatch):
    folder = tmp_path / "a"
    flock = files.fcntl.flock

    def removed_meanwhile(descriptor, how):
        flock(descriptor, how)
        monkeypatch.setattr(files.fcntl, "flock", flock)
        folder.rmdir()

    monkeypatch.setattr(files.fcntl, "flock", removed_meanwhile)
    with files.claimed(folder):
        assert claimed_by_another(folder).startswith("another process")
