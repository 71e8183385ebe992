import numpy as np
import pytest

from ciphernav_jax.world import visibility
from ciphernav_jax.world.grid import WALLS
from ciphernav_jax.world.poses import POSE_CELL, POSES, agent_pose
from ciphernav_jax.world.renderer import renderer
from ciphernav_jax.world.scenario import Obstacle
from ciphernav_jax.world.shards import Request

EAST, SOUTH, WEST = 3, 1, 2


def box(x, z):
    return Obstacle(cell=0, shape=0, colour=0, x=x, z=z, yaw=0.0)


@pytest.mark.parametrize(
    ("pose", "obstacle", "expected"),
    [
        (agent_pose(0, EAST), box(10.0, 1.0), True),  # at the far end of the top lane
        (agent_pose(0, WEST), box(10.0, 1.0), False),  # behind
        (agent_pose(0, EAST), box(10.0, 3.25), False),  # around the corner
        (agent_pose(0, EAST), box(10.0, 2.0), True),  # half around the corner
        (agent_pose(10, EAST), box(10.0, 5.5), False),  # behind the inner rooms' walls
        (2, box(1.0, 1.0), True),  # in a camera's own cell, in front of it
    ],
)
def test_single_obstacles_in_the_ring(pose, obstacle, expected):
    assert visibility.visible(11, [obstacle])[pose, 0] == expected


def test_sight_goes_through_open_rooms():
    assert visibility.visible(8, [box(10.0, 5.5)])[agent_pose(10, EAST), 0]


def test_no_obstacle_is_missed():
    """Whatever changes a pixel is declared visible; little else is."""
    request = Request("validation", 24, seed=3)
    changed = declared = 0
    for index in range(request.count):
        world = request.scenario(index)
        poses = np.flatnonzero(~WALLS[world.layout, POSE_CELL] & ~world.obstacle_cells[POSE_CELL])
        with_obstacles = renderer().render(world.layout, world.obstacles, poses)
        without = renderer().render(world.layout, (), poses)
        differs = (with_obstacles != without).any((1, 2, 3))
        visible = visibility.visible(world.layout, world.obstacles)[poses].any(axis=1)
        assert not (differs & ~visible).any(), index
        changed += differs.sum()
        declared += visible.sum()
    assert declared <= 1.1 * changed


def test_nothing_is_seen_from_inside_walls():
    visible = visibility.visible(11, [box(1.0, 5.5)])
    assert visible.shape == (POSES, 1)
    assert not visible[WALLS[11, POSE_CELL]].any()
