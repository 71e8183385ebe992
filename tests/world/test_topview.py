import numpy as np
import pytest

from ciphernav_jax.world.poses import EXTENT, centre
from ciphernav_jax.world.scenario import Obstacle, Scenario
from ciphernav_jax.world.topview import draw

WORLD = Scenario(11, 3, 20, (Obstacle(4, shape=1, colour=1, x=10.0, z=1.0, yaw=0.0),))


def pixel(picture, point):
    """The colour at a point in metres; a margin of 0.25 surrounds the world."""
    x, z = ((np.asarray(point) + 0.25) / (EXTENT + 0.5) * len(picture)).astype(int)
    return picture[z, x].tolist()


def test_picture_shows_walls_obstacles_goal_and_path():
    picture = draw(WORLD, [0, 1, 2])
    assert picture.shape == (480, 480, 3)
    assert picture.dtype == np.uint8
    assert pixel(picture, centre(12)) == pixel(picture, (2.125 + 0.2, 3.25))  # walls within and around
    assert pixel(picture, centre(4)) == [0, 0, 230]  # the blue ball
    assert pixel(picture, centre(20)) == [170, 222, 160]  # the goal
    assert pixel(picture, centre(1)) != pixel(draw(WORLD), centre(1))  # the path
    assert draw(WORLD, size=100).shape == (100, 100, 3)


@pytest.mark.parametrize("other", [{"crashed": True}, {"heading": 1}, {"path": [0, 5, 10]}])
def test_pictures_of_different_episodes_differ(other):
    assert (draw(WORLD, **{"path": [0, 1, 2]} | other) != draw(WORLD, [0, 1, 2])).any()


def test_heading_follows_the_last_step():
    np.testing.assert_array_equal(draw(WORLD, [0, 5]), draw(WORLD, [0, 5], heading=1))
    np.testing.assert_array_equal(draw(WORLD), draw(WORLD, heading=WORLD.start_heading))
