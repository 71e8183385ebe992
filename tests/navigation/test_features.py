import numpy as np
import pytest
from flax import nnx

from ciphernav_jax.models import Navigator
from ciphernav_jax.navigation import features
from ciphernav_jax.navigation.methods import METHODS
from ciphernav_jax.navigation.samples import teacher_forced
from ciphernav_jax.world.grid import WALLS, map_code


@pytest.fixture(scope="module")
def navigator():
    return Navigator(nnx.Rngs(0))


def encoded(world, navigator, name):
    return features.encode(world, METHODS[name], navigator.view_encoder, navigator.map_encoder)


def test_each_slot_is_the_encoder_applied_to_its_own_view(world, navigator):
    env, cell, heading = np.array([3, 5]), np.array([0, 0]), np.array([1, 3])
    slots = encoded(world, navigator, "plaintext").slots(env, cell, heading)
    views = [world.views[world.cameras[env, which]] for which in range(4)]
    views.append(world.views[world.agent[env, cell, heading]])
    encode = nnx.jit(lambda encoder, view: encoder(view))
    for slot, view in zip(slots[:5], views, strict=True):
        np.testing.assert_allclose(slot, encode(navigator.view_encoder, view), atol=1e-5)
    maps = map_code(WALLS[world.layout[env]], cell, world.goal[env])
    np.testing.assert_allclose(slots[5], navigator.map_encoder(maps), atol=1e-5)
    assert {slot.dtype for slot in slots} == {np.dtype(np.float32)}


@pytest.mark.parametrize(
    ("name", "held"),
    [
        ("map-only", [0, 0, 0, 0, 0, 1]),
        ("first-person", [0, 0, 0, 0, 1, 1]),
        ("plaintext", [1, 1, 1, 1, 1, 1]),
    ],
)
def test_slots_that_a_method_has_not_are_zero(world, navigator, name, held):
    start = np.zeros(2, int)
    slots = encoded(world, navigator, name).slots(np.arange(2), start, start + 3)
    assert [int(slot.any()) for slot in slots] == held


def test_standardised_features_have_mean_zero_and_no_spread_above_one(world, navigator):
    seen, samples = encoded(world, navigator, "plaintext"), teacher_forced(world, METHODS["plaintext"])
    standard = features.standardise(seen, features.fit_scales(seen, samples))
    slots = (*standard.cameras, *standard.robot(samples.env, samples.cell, samples.heading, samples.goal))
    for slot in slots:
        np.testing.assert_allclose(slot.mean(0), 0, atol=1e-4)
        assert slot.std(0).max() < 1 + 1e-4


def test_unscaled_changes_nothing(world, navigator):
    seen = encoded(world, navigator, "plaintext")
    same = features.standardise(seen, features.unscaled())
    np.testing.assert_array_equal(same.maps, seen.maps)
    np.testing.assert_array_equal(same.cameras[2], seen.cameras[2])
