"""The examples run, at a small size, and are short."""

import importlib.util
from pathlib import Path

import jax
import numpy as np
import pytest
from PIL import Image, ImageSequence

pytestmark = pytest.mark.slow

FOLDER = Path(__file__).parents[1] / "examples"
EXAMPLES = sorted(FOLDER.glob("*.py"))


@pytest.fixture(autouse=True)
def as_users_have_it():
    """JAX's own promotion of types, which the tests make strict: optax does not heed that."""
    with jax.numpy_dtype_promotion("standard"):
        yield


def load(name):
    spec = importlib.util.spec_from_file_location(f"examples_{name}", FOLDER / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_they_are_short_and_say_how_to_run_them(path):
    lines = path.read_text().splitlines()
    assert len(lines) < 60
    assert lines[2].startswith(f"python examples/{path.name}")


def test_a_vertically_split_table_goes_on_from_the_parties_files(tmp_path, capsys):
    assert load("vertical_split").main(rows=60, steps=5, out=tmp_path) > 0.8
    assert "right after 10 steps" in capsys.readouterr().out
    rows = [np.load(tmp_path / f"party-{party}.npy") for party in range(2)]
    assert all(row.shape == (4,) and row.dtype == np.uint64 for row in rows)
    assert (
        np.abs(np.sum(rows, axis=0).view(np.int64)).max() < 2**30
    )  # the sum is small; what each has is noise
    assert np.abs(rows[0].view(np.int64)).max() > 2**50


def test_a_random_robot_is_recorded(tmp_path):
    out = tmp_path / "made" / "random.gif"
    load("random_agent_gif").main(out, episodes=2)
    assert len(ImageSequence.all_frames(Image.open(out))) >= 4


def test_an_agent_imitates_the_expert():
    assert load("imitation").main(episodes=12, steps=60, trials=4) >= 0


def test_variants_are_compared():
    variants = ("default", "truncation=nearest")
    found = load("variants").main(parties=2, rows=5, variants=variants)
    assert tuple(found) == variants
    (_, sent, _, error), (_, more, *_) = found.values()
    assert error < 1e-4
    assert more > sent
