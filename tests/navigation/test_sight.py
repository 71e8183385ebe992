"""What a robot learns to see for itself, on a small world whose views show the obstacles of a lane."""

import jax
import numpy as np
import pytest
from flax import nnx

from ciphernav_jax.files import DamagedError
from ciphernav_jax.learning.storage import Checkpoint
from ciphernav_jax.models import Sight
from ciphernav_jax.navigation import folders, sight, trainings
from ciphernav_jax.navigation.sight import Looking
from ciphernav_jax.world.grid import WALLS
from tests.navigation.conftest import Killed, assert_same, killed_after_first, line, perfect_eyes, silent

pytestmark = pytest.mark.slow

RECIPE = Looking(steps=120, batch=200, chunk=60)


@pytest.fixture(scope="module")
def learned(world, tmp_path_factory):
    folder = tmp_path_factory.mktemp("sight") / "training"
    points = []
    weights = trainings.train_sight(world, RECIPE, 0, folder, lambda done, total, point: points.append(done))
    return folder, weights, points


def test_its_parameters_are_an_encoders_and_132_more():
    count = sum(leaf.size for leaf in jax.tree.leaves(nnx.state(Sight(nnx.Rngs(0)), nnx.Param)))
    assert count == 88_562 + 4 * 33


def test_it_tells_the_nearest_obstacle_in_each_direction(world, learned):
    _, weights, points = learned
    assert points == [60, 120]
    found = sight.obstacles_in_sight(world, weights)
    expected = perfect_eyes(world)
    assert expected.sum() > 300
    assert (found != expected).sum() < 0.02 * expected.sum()


def test_whatever_it_answers_it_sees_nothing_in_or_behind_walls_nor_off_its_lines(world):
    weights = jax.tree.map(np.zeros_like, sight.initial(0))
    weights["ahead"]["bias"] += 1
    found = sight.obstacles_in_sight(world, weights)
    for env, cell in np.ndindex(len(world), 25):
        walls = WALLS[world.layout[env]]
        blocked = walls | world.obstacles[env]
        open_ = {there for heading in range(4) for there in line(walls, cell, heading)}
        assert set(np.flatnonzero(found[env, cell]).tolist()) == (set() if blocked[cell] else open_)


def test_a_finished_one_is_read_back_and_a_killed_one_goes_on(world, learned, tmp_path):
    folder, weights, _ = learned
    read = trainings.train_sight(world, RECIPE, 0, folder, lambda *_: pytest.fail("trained again"))
    assert_same(read, weights)
    assert [point["step"] for point in folders.curve(folder)] == [60, 120]
    with pytest.raises(DamagedError, match="another training"):
        trainings.train_sight(world, Looking(steps=180, batch=200, chunk=60), 0, folder, silent)

    with pytest.raises(Killed):
        sight.train_eyes(world, RECIPE, 0, Checkpoint(tmp_path / "checkpoint.npz"), killed_after_first)
    resumed, curve = sight.train_eyes(world, RECIPE, 0, Checkpoint(tmp_path / "checkpoint.npz"), silent)
    assert len(curve) == 2
    assert_same(resumed, weights)
