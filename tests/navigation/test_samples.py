import dataclasses

import numpy as np

from ciphernav_jax.navigation.methods import METHODS
from ciphernav_jax.navigation.samples import errands, start_headings, teacher_forced, training_samples
from ciphernav_jax.world.grid import START
from ciphernav_jax.world.planner import guide, paths


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


def test_errands_lead_to_goals_of_their_own_and_know_the_right_action(world):
    samples = errands(world, METHODS["plaintext"], seed=1, count=3, stray=0.0)
    assert (np.diff(samples.env) >= 0).all()
    starts, ends = samples.cell == START, samples.action == 0
    assert starts.sum() == ends.sum() == 3 * len(world)
    np.testing.assert_array_equal(samples.cell[ends], samples.goal[ends])
    blocked = world.walls | world.obstacles
    for env, goal in zip(samples.env[starts].tolist(), samples.goal[starts].tolist(), strict=True):
        path = paths(blocked[env])[goal]
        of_path = (samples.env == env) & (samples.goal == goal)
        assert set(path) == set(samples.action[of_path].tolist()) - {0}


def test_a_robot_that_strays_stays_on_free_cells_and_is_told_the_way_from_there(world):
    samples = errands(world, METHODS["plaintext"], seed=1, count=2, stray=0.5)
    blocked = world.walls | world.obstacles
    assert not blocked[samples.env, samples.cell].any()
    assert (world.agent[samples.env, samples.cell, samples.heading] >= 0).all()
    right = guide(blocked[samples.env], samples.goal)[np.arange(len(samples)), samples.cell]
    np.testing.assert_array_equal(samples.action, right)
    straight = errands(world, METHODS["plaintext"], seed=1, count=2, stray=0.0)
    assert len(samples) > len(straight)


def test_without_errands_the_samples_are_the_papers(world):
    alone, more = (training_samples(world, METHODS["plaintext"], 0, count, 0.0) for count in (0, 1))
    for name, rows in vars(teacher_forced(world, METHODS["plaintext"])).items():
        np.testing.assert_array_equal(getattr(alone, name), rows)
    assert len(more) > len(alone)
