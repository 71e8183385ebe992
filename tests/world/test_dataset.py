import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from ciphernav_jax import files
from ciphernav_jax.files import BusyError, DamagedError
from ciphernav_jax.world import dataset, planner, shards
from ciphernav_jax.world.environment import ObstacleWorld
from ciphernav_jax.world.generate import Generate, render
from ciphernav_jax.world.grid import WALLS
from ciphernav_jax.world.journal import Journal
from ciphernav_jax.world.poses import CAMERAS
from ciphernav_jax.world.shards import Request
from tests.patience import wait_for


def bytes_of(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def test_shapes_dtypes_and_counts(arguments, small):
    n, v = len(small), len(small.views)
    assert n == arguments["count"]
    assert small.views.shape == (v, 45, 60, 3)
    for name, dtype, shape in (
        ("views", np.uint8, (v, 45, 60, 3)),
        ("cameras", np.int32, (n, 4)),
        ("agent", np.int32, (n, 25, 4)),
        ("layout", np.uint8, (n,)),
        ("obstacles", np.bool_, (n, 25)),
        ("start_heading", np.uint8, (n,)),
        ("goal", np.uint8, (n,)),
        ("actions", np.int8, (n, 17)),
        ("detour", np.bool_, (n,)),
    ):
        array = getattr(small, name)
        assert (array.dtype, array.shape) == (dtype, shape), name
        assert isinstance(array, np.memmap), name
    assert small.detour.sum() == n / 2
    assert small.meta["seed"] == 0
    assert small.meta["versions"]["miniworld"]
    assert repr(small) == f"Dataset({small.meta['split']}: {n} environments, {v:,} views)"


def test_every_free_cell_has_views_and_none_is_kept_twice(small):
    free = ~(WALLS[small.layout] | small.obstacles)
    assert ((small.agent >= 0) == free[:, :, None]).all()
    used = np.unique(np.concatenate([small.cameras.ravel(), small.agent[free].ravel()]))
    assert len({view.tobytes() for view in small.views}) == len(small.views)
    # Backgrounds are drawn for every layout, whether or not it came up.
    assert 0 <= len(small.views) - len(used) < 100
    assert used.max() == len(small.views) - 1


def test_rows_are_the_requested_scenarios(arguments, small):
    request = Request(**arguments)
    for index in range(0, len(small), 7):
        world = request.scenario(index)
        assert small.scenario(index) == world
        np.testing.assert_array_equal(small.actions[index], planner.labels(world.path))
        np.testing.assert_array_equal(small.walls[index], world.walls)
        assert small.detour[index] == world.detour
        assert world.key in small.pairs()


def test_pixels_equal_the_environments(small):
    """Along every shortest path of a few environments, the five views are the data set's."""
    env = ObstacleWorld()
    for index in range(0, len(small), 5):
        observation, info = env.reset(options={"scenario": small.scenario(index)})
        for action in small.actions[index]:
            agent = small.views[small.agent[index, info["cell"], info["heading"]]]
            np.testing.assert_array_equal(observation["agent"], agent)
            for name, view in zip(CAMERAS, small.views[small.cameras[index]], strict=True):
                np.testing.assert_array_equal(observation[name], view)
            observation, _, terminated, _, info = env.step(action)
            if terminated:
                break
        assert info["outcome"] == "success"
        assert info["efficient"]


def test_killed_run_resumes_to_the_same_bytes(arguments, small_folder, tmp_path):
    out = tmp_path / "killed"
    program = f"from ciphernav_jax.world import dataset; dataset.generate(**{arguments!r}, out={str(out)!r})"
    process = subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.DEVNULL)
    partial = tmp_path / "killed.partial"
    wait_for(lambda: (partial / "record-00001.npz").exists())
    workers = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()
    process.send_signal(signal.SIGKILL)
    process.wait()
    assert workers
    wait_for(lambda: not any(alive(worker) for worker in workers))
    assert not out.exists()

    with open(partial / "data" / "views.npy", "ab") as file:
        file.write(b"half an image")
    (partial / "record-00002.new").write_bytes(b"half a record")
    with pytest.raises(FileExistsError, match="another request"):
        dataset.generate(**arguments | {"seed": 1}, out=out, progress=False)
    with files.claimed(partial), pytest.raises(BusyError, match="another process"):
        dataset.generate(**arguments, out=out, progress=False)
    dataset.generate(**arguments, out=out, workers=1, progress=False)
    assert bytes_of(out) == bytes_of(small_folder)
    assert not partial.exists()


def test_records_without_their_images_count_for_nothing(arguments, tmp_path):
    """As after a loss of power, or when a finished folder was removed before its records were."""
    out, partial = tmp_path / "out", tmp_path / "out.partial"
    first = dataset.draw_shards(Request(**arguments), [shards.BACKGROUNDS], workers=1)
    journal = Journal(out, {})
    journal.add(next(first))
    assert journal.shards == 1
    assert journal.views > 12
    del journal
    flip_a_byte(partial / "data")
    with pytest.raises(DamagedError, match=rf"views\.npy is not what.*remove {partial} and run"):
        Journal(out, {})
    os.truncate(partial / "data" / "views.npy", 5_000)
    journal = Journal(out, {})
    assert (journal.shards, journal.views) == (0, 0)
    (partial / "record-00000.npz").unlink()  # whatever comes after it counts for nothing, too
    assert Journal(out, {}).shards == 0


def alive(pid):
    try:
        return Path(f"/proc/{pid}/stat").read_text().split()[2] != "Z"
    except FileNotFoundError:
        return False


def test_a_finished_folder_is_kept_and_a_foreign_one_refused(arguments, small_folder, monkeypatch):
    monkeypatch.setattr(dataset, "draw_shards", None)  # nothing may be drawn
    before = bytes_of(small_folder)
    dataset.generate(**arguments, out=small_folder, progress=False)
    with pytest.raises(FileExistsError, match="something else"):
        dataset.generate(**arguments | {"count": 10}, out=small_folder)
    assert bytes_of(small_folder) == before


def test_unseen_set_by_the_command(small, small_folder, tmp_path, capsys):
    out = tmp_path / "unseen"
    render(Generate(out=out, split="test", count=6, unseen_by=small_folder, workers=1))
    unseen = dataset.load(out)
    assert not unseen.pairs() & small.pairs()
    assert unseen.meta["unseen_by"]
    assert "6 environments, 3 of them with a detour" in capsys.readouterr().out


def test_a_set_that_is_only_drawn_is_left_out_like_one_that_is_rendered(
    arguments, small, small_folder, tmp_path
):
    only_drawn = Request(**arguments)
    assert only_drawn.pairs() == small.pairs()
    sets = {"folder": small_folder, "request": only_drawn}
    for name, unseen_by in sets.items():
        dataset.generate("test", 4, 0, tmp_path / name, workers=1, unseen_by=unseen_by, progress=False)
    assert bytes_of(tmp_path / "request") == bytes_of(tmp_path / "folder")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"split": "dev"}, "split='dev'"),
        ({"count": 0}, "count=0 must lie in"),
        ({"seed": -1}, "seed=-1"),
        ({"workers": 0}, "workers=0"),
    ],
)
def test_wrong_arguments_are_named(arguments, change, message, tmp_path):
    with pytest.raises(ValueError, match=message):
        dataset.generate(**arguments | {"out": tmp_path / "none"} | change)


def test_a_dead_worker_is_reported(arguments, monkeypatch):
    monkeypatch.setattr(shards.sys, "executable", "/bin/false")
    with pytest.raises(RuntimeError, match=r"died \(exit status 1\).*resume"):
        list(shards.draw_shards(Request(**arguments), [0], workers=1))


def test_a_slow_worker_is_reported(arguments, monkeypatch):
    monkeypatch.setattr(shards, "_TIMEOUT", 0.01)
    with pytest.raises(TimeoutError, match="resume"):
        list(shards.draw_shards(Request(**arguments), [0], workers=1))


def test_an_error_in_a_worker_is_raised_here():
    with pytest.raises(ValueError, match="non-negative"):
        list(shards.draw_shards(Request("train", 5, seed=-1), [0], workers=1))


def flip_a_byte(folder):
    with open(folder / "views.npy", "r+b") as file:
        file.seek(-5, os.SEEK_END)
        byte = file.read(1)[0]
        file.seek(-1, os.SEEK_CUR)
        file.write(bytes([byte ^ 1]))


def rewrite_meta(folder, **changes):
    files.write_json(folder / "meta.json", files.read_json(folder / "meta.json") | changes)


@pytest.mark.parametrize(
    ("harm", "file", "verify"),
    [
        (flip_a_byte, "views.npy is damaged", True),
        (lambda f: os.truncate(f / "views.npy", 100_000), "views.npy is 100000 bytes long", False),
        (lambda f: (f / "goal.npy").unlink(), "goal.npy is missing", False),
        (lambda f: shutil.copy(f / "goal.npy", f / "layout.npy"), "layout.npy is damaged", True),
        (lambda f: np.save(f / "goal.npy", np.zeros(130, np.int8)), "goal.npy holds int8", False),
        (lambda f: (f / "goal.npy").write_bytes(bytes(258)), "goal.npy is no NumPy array", False),
        (lambda f: (f / "meta.json").write_text("{"), "meta.json is damaged", True),
        (lambda f: rewrite_meta(f, format="something else"), "meta.json does not describe", True),
        (lambda f: rewrite_meta(f, count=131), "layout.npy holds|cameras.npy holds", True),
    ],
)
def test_harmed_folders_are_refused_by_name(small_folder, tmp_path, harm, file, verify):
    folder = tmp_path / "harmed"
    shutil.copytree(small_folder, folder)
    harm(folder)
    with pytest.raises(DamagedError, match=file):
        dataset.load(folder, verify=verify)


def test_a_folder_without_data_is_refused(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"meta\.json is missing.*ciphernav generate"):
        dataset.load(tmp_path)
