"""What a robot learns to see for itself, on a small world whose views show the obstacles of a lane."""

import jax
import numpy as np
import pytest
from flax import nnx

from ciphernav_jax.models import Sight
from ciphernav_jax.navigation import sight, trained
from ciphernav_jax.navigation.sight import Looking
from ciphernav_jax.navigation.storage import Checkpoints, DamagedError
from ciphernav_jax.world.grid import WALLS, move
from tests.navigation.conftest import Killed, assert_same, killed_after_first, silent

RECIPE = Looking(steps=120, batch=200, chunk=60)


@pytest.fixture(scope="module")
def learned(world, tmp_path_factory):
    folder = tmp_path_factory.mktemp("sight") / "training"
    points = []
    weights = trained.train_sight(world, RECIPE, 0, folder, lambda done, total, point: points.append(done))
    return folder, weights, points


def test_its_parameters_are_an_encoders_and_33_more():
    count = sum(leaf.size for leaf in jax.tree.leaves(nnx.state(Sight(nnx.Rngs(0)), nnx.Param)))
    assert count == 88_562 + 33


def test_it_tells_obstacles_ahead(world, learned):
    _, weights, points = learned
    assert points == [60, 120]
    found = sight.obstacles_ahead(world, weights)
    free = ~(WALLS[world.layout] | world.obstacles)
    right = wrong = obstacles = 0
    for env, cell in np.argwhere(free).tolist():
        for heading in range(4):
            following = int(move(cell, heading + 1))
            if following >= 0 and not WALLS[world.layout[env], following]:
                right += found[env, cell, heading] == world.obstacles[env, following]
                wrong += found[env, cell, heading] != world.obstacles[env, following]
                obstacles += int(world.obstacles[env, following])
    assert obstacles > 50
    assert wrong <= 0.01 * right
    assert not found[~free].any()


def test_a_finished_one_is_read_back_and_a_killed_one_goes_on(world, learned, tmp_path):
    folder, weights, _ = learned
    read = trained.train_sight(world, RECIPE, 0, folder, lambda *_: pytest.fail("trained again"))
    assert_same(read, weights)
    assert [point["step"] for point in trained.curve(folder)] == [60, 120]
    with pytest.raises(DamagedError, match="another training"):
        trained.train_sight(world, Looking(steps=180, batch=200, chunk=60), 0, folder, silent)

    with pytest.raises(Killed):
        sight.train(world, RECIPE, 0, Checkpoints(tmp_path / "checkpoints"), killed_after_first)
    resumed, curve = sight.train(world, RECIPE, 0, Checkpoints(tmp_path / "checkpoints"), silent)
    assert len(curve) == 2
    assert_same(resumed, weights)
