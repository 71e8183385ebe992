import dataclasses

import numpy as np

from ciphernav_jax.navigation.methods import METHODS
from ciphernav_jax.navigation.samples import start_headings, teacher_forced


def by_hand(world, actions, start_heading):
    labels = np.full((1, 17), -1, np.int8)
    labels[0, : len(actions)] = actions
    return dataclasses.replace(
        world, actions=labels, start_heading=np.array([start_heading], np.uint8), layout=world.layout[:1]
    )


def test_the_label_moves_the_robot_and_turns_it(world):
    samples = teacher_forced(by_hand(world, [4, 4, 2, 3, 1, 0], start_heading=1), METHODS["plaintext"])
    assert samples.cell.tolist() == [0, 1, 2, 7, 6, 1]
    assert samples.heading.tolist() == [1, 3, 3, 1, 2, 0]
    assert samples.action.tolist() == [4, 4, 2, 3, 1, 0]
    assert samples.env.tolist() == [0] * 6


def test_a_fixed_start_looks_right(world):
    one = by_hand(world, [2, 0], start_heading=1)
    samples = teacher_forced(one, METHODS["first-person-deterministic"])
    assert samples.heading.tolist() == [3, 1]
    assert start_headings(one, METHODS["first-person"]).tolist() == [1]


def test_every_path_ends_on_its_goal_and_has_its_views(world):
    samples = teacher_forced(world, METHODS["plaintext"])
    ends = samples.action == 0
    np.testing.assert_array_equal(samples.cell[ends], world.goal)
    assert (world.agent[samples.env, samples.cell, samples.heading] >= 0).all()
    assert len(samples) == (world.actions >= 0).sum()
