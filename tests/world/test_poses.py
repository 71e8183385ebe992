"""Where the cameras stand and what they look along."""

from ciphernav_jax.world.poses import CAMERAS, LANES


def test_each_camera_looks_along_the_lane_named_after_it():
    lanes = dict(zip(CAMERAS, LANES.tolist(), strict=True))
    assert lanes == {
        "bottom_left": [20, 15, 10, 5, 0],
        "bottom_right": [24, 23, 22, 21, 20],
        "top_left": [0, 1, 2, 3, 4],
        "top_right": [4, 9, 14, 19, 24],
    }
