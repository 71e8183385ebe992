import numpy as np
from PIL import Image

from ciphernav_jax.navigation import pictures
from ciphernav_jax.navigation.rollout import random_walk


def test_pictures_are_written(world, tmp_path):
    walks = random_walk(world, seed=0)
    points = [{"epoch": 1, "loss": 1.0, "accuracy": 50.0}, {"epoch": 2, "loss": 0.5, "accuracy": 70.0}]
    pictures.curves({"Map only": points}, {"2 parties": [{"step": 5, "loss": 0.1}]}, tmp_path / "curves.png")
    pictures.episodes(world, {"Random walk": walks}, [0, 1], tmp_path / "episodes.png")
    for name in ("curves.png", "episodes.png"):
        assert np.asarray(Image.open(tmp_path / name)).std() > 10
    assert not list(tmp_path.glob("*.part"))


def test_the_picture_shows_where_eyes_help_where_they_do_not_and_where_they_fail(world):
    blind, seeing = random_walk(world, seed=0), random_walk(world, seed=1)
    chosen = pictures.interesting(world, blind, seeing)
    won = [bool(seeing.outcome[env] == 0) for env in chosen]
    assert len(set(chosen)) == len(chosen) <= 5
    assert not won[-1]
    assert all(won[:-1])
