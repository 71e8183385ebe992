"""A sample of `tests.fuzz`; the script tries many more."""

import random
import shutil
from pathlib import Path

import pytest

from ciphernav_jax import files
from ciphernav_jax.navigation import folders
from tests import fuzz

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def ground(tmp_path_factory):
    with fuzz.faked():
        yield fuzz.Fuzz(tmp_path_factory.mktemp("fuzz"))


def test_what_is_harmed_is_named_or_does_no_harm(ground):
    cases = [ground.file(random.Random(f"sample {number}")) for number in range(60)]
    cases += [ground.option(random.Random(f"sample {number}")) for number in range(60)]
    assert [case for case in cases if case.verdict == "other"] == []
    assert {case.verdict for case in cases} == {"clear", "harmless"}


@pytest.mark.parametrize(
    "words",
    [
        f"generate --out new --count 1 --workers 1024 --seed {2**63 - 1}",
        f"evaluate --model random --data world/test --out new --seed {2**63 - 1}",
        "sweep --function tests.fuzz:squares --out new --parties 1024 --variant default --repeat 1000000000",
    ],
)
def test_the_ends_of_ranges_are_in_them(ground, tmp_path, words):
    shutil.copytree(ground.ground / "world", tmp_path / "world")
    assert fuzz.run(words.split(), tmp_path) == fuzz.Ended(0, "")


def scene(name):
    return next(scene for scene in fuzz.SCENES if scene.name == name)


def test_a_missing_result_that_is_replaced_is_found(ground, monkeypatch):
    monkeypatch.setattr(folders, "result", lambda folder, config, like: like)
    case = ground.harm(scene("training"), fuzz.lose, Path("plain/model.npz"), random.Random(0))
    assert case.verdict == "other"
    assert case.ended.code == 0


def test_a_file_that_is_not_checked_is_found(ground, monkeypatch):
    monkeypatch.setattr(files, "_damaged", lambda path, remedy: KeyError("digest"))
    case = ground.harm(scene("training"), fuzz.noise, Path("plain/model.npz"), random.Random(0))
    assert (case.verdict, case.ended.code) == ("other", -1)


@pytest.mark.parametrize("job", ["generate", "train", "sweep"])
def test_killed_at_a_random_write_and_run_again_it_leaves_the_same_bytes(ground, tmp_path, job):
    case = fuzz.Kills(ground.ground, tmp_path / "killed").kill(job, random.Random(1))
    assert case.verdict == "harmless", case
    assert "killed [{" in case.what
