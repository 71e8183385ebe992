import dataclasses

import numpy as np
import pytest

from ciphernav_jax.navigation.methods import METHODS
from ciphernav_jax.navigation.metrics import overall, tally
from ciphernav_jax.navigation.rollout import Careful, Outcome, random_walk, rollout
from ciphernav_jax.navigation.samples import start_headings
from ciphernav_jax.world.grid import WALLS
from tests.navigation.conftest import perfect_eyes

LAYOUT = 11  # ring only


def script(*actions):
    """A policy that takes these actions whatever it sees, and then waits to be done."""
    return lambda step, cells, headings: np.full(len(cells), actions[step] if step < len(actions) else 1)


def oracle(world):
    """A policy that gives the right answers."""
    return lambda step, cells, headings: np.maximum(world.actions[:, step], 0).astype(np.int64)


@pytest.fixture
def ring(world):
    """One environment without inner cells: goal in cell 2, an obstacle in cell 10."""
    obstacles = np.zeros((1, 25), bool)
    obstacles[0, 10] = True
    return dataclasses.replace(
        world,
        layout=np.array([LAYOUT], np.uint8),
        obstacles=obstacles,
        goal=np.array([2], np.uint8),
        start_heading=np.array([3], np.uint8),
        detour=np.array([False]),
        actions=np.array([[4, 4, 0] + [-1] * 14], np.int8),
    )


@pytest.mark.parametrize(
    ("actions", "outcome", "length"),
    [
        ([4, 4, 0], Outcome.SUCCESS, 3),
        ([4, 3, 4, 4, 0], Outcome.SUCCESS, 5),
        ([4, 0], Outcome.NO_CRASH, 2),
        ([2, 2], Outcome.CRASH_OBSTACLE, 2),
        ([4, 2], Outcome.CRASH_WALL, 2),
        ([1], Outcome.CRASH_WALL, 1),
        ([4, 3] * 8 + [4], Outcome.NO_CRASH, 17),
        ([4, 3] * 7 + [4, 4, 0], Outcome.SUCCESS, 17),
    ],
)
def test_outcomes_by_hand(ring, actions, outcome, length):
    assert WALLS[LAYOUT].sum() == 9
    episodes = rollout(ring, script(*actions), np.array([3]))
    assert episodes.outcome.tolist() == [outcome]
    assert episodes.lengths.tolist() == [length]


def test_efficient_is_no_longer_than_the_label(ring):
    direct = tally(ring, rollout(ring, script(4, 4, 0), np.array([3])))
    winding = tally(ring, rollout(ring, script(4, 3, 4, 4, 0), np.array([3])))
    assert [overall(counts)["efficient"] for counts in (direct, winding)] == [1, 0]
    assert [overall(counts)["success"] for counts in (direct, winding)] == [1, 1]


def test_the_path_is_recorded_up_to_the_crash(ring):
    episodes = rollout(ring, script(4, 2), np.array([3]))
    assert episodes.cells[0, :3].tolist() == [0, 1, -1]
    assert episodes.actions[0, :3].tolist() == [4, 2, -1]


def test_an_oracle_always_arrives_by_the_shortest_path(world):
    episodes = rollout(world, oracle(world), start_headings(world, METHODS["plaintext"]))
    counts = overall(tally(world, episodes))
    assert counts["trials"] == counts["success"] == counts["efficient"] == len(world)
    np.testing.assert_array_equal(episodes.actions, world.actions)


def test_policies_see_the_heading_of_the_last_move(ring):
    seen = []

    def policy(step, cells, headings):
        seen.append((int(cells[0]), int(headings[0])))
        return np.array([[4, 4, 0][step]])

    rollout(ring, policy, np.array([1]))
    assert seen == [(0, 1), (1, 3), (2, 3)]


def test_a_random_walk_never_crashes_and_succeeds_on_entering_the_goal(world):
    episodes = random_walk(world, seed=0)
    counts = overall(tally(world, episodes))
    assert counts["crash_obstacle"] == counts["crash_wall"] == 0
    won = episodes.outcome == Outcome.SUCCESS
    last = episodes.cells[np.arange(len(world)), episodes.lengths]
    assert won.any()
    np.testing.assert_array_equal(last == world.goal, won)
    np.testing.assert_array_equal(random_walk(world, seed=0).actions, episodes.actions)


def careful(world, policy, eyes=None):
    robots = Careful(policy, world, perfect_eyes(world) if eyes is None else eyes)
    return robots, rollout(world, robots, start_headings(world, METHODS["plaintext"]))


def path(*moves):
    """A row of actions that ends with a stop."""
    return [*moves, 0] + [-1] * (16 - len(moves))


@pytest.mark.parametrize(
    ("answers", "actions", "alone"),
    [
        ([4, 4, 1], [4, 4], False),  # it stops on its goal without asking
        ([0], [4, 4], True),  # to stop elsewhere makes no sense
        ([1], [4, 4], True),  # nor to leave the grid
        ([4, 2], [4, 4], True),  # nor a wall
        ([2], [4, 4], True),  # nor to go where an obstacle in sight leaves no way on
        ([4, 3], [4, 4], True),  # nor to go back
    ],
)
def test_a_careful_robot_follows_what_makes_sense_and_else_its_map(ring, answers, actions, alone):
    robot, episodes = careful(ring, script(*answers))
    assert episodes.actions[0].tolist() == path(*actions)
    assert robot.alone.tolist() == [alone]


@pytest.mark.parametrize(("goal", "actions"), [(4, None), (3, [4, 4, 2, 2, 1, 1, 4])])
def test_a_careful_robot_goes_no_way_that_takes_more_actions_than_are_left(ring, goal, actions):
    # Through the middle, and around by the south: to cell 4 that takes all 16 moves, to cell 3 one more.
    longest = [4, 4, 2, 2, 3, 3, 2, 2, 4, 4, 4, 4, 1, 1, 1, 1, 3]
    cross = dataclasses.replace(
        ring,
        layout=np.array([10], np.uint8),
        obstacles=np.zeros((1, 25), bool),
        goal=np.array([goal], np.uint8),
    )
    robot, episodes = careful(cross, script(*longest))
    assert episodes.actions[0].tolist() == path(*(actions or longest[:16]))
    assert robot.alone.tolist() == [actions is not None]


def test_a_careful_robot_remembers_obstacles_and_goes_around(ring):
    # Down the left side stands the obstacle, in cell 10, in sight from the start; around it are twelve moves.
    world = dataclasses.replace(ring, goal=np.array([20], np.uint8))
    robot, episodes = careful(world, script(2))
    assert episodes.actions[0].tolist() == path(4, 4, 4, 4, 2, 2, 2, 2, 3, 3, 3, 3)
    assert robot.alone.tolist() == [True]


def test_a_careful_robot_whose_eyes_see_a_wall_of_obstacles_does_as_it_is_told(ring):
    _, episodes = careful(ring, script(4, 4), eyes=np.ones((1, 25, 25), bool))
    assert episodes.actions[0].tolist() == path(4, 4)


def test_careful_robots_follow_every_right_answer(world):
    robots, episodes = careful(world, oracle(world))
    np.testing.assert_array_equal(episodes.actions, world.actions)
    assert not robots.alone.any()


def test_careful_robots_never_crash_whatever_they_are_told(world):
    def nonsense(step, cells, headings):
        return np.random.default_rng(step).integers(0, 5, len(cells))

    robots, episodes = careful(world, nonsense)
    assert set(episodes.outcome.tolist()) <= {Outcome.SUCCESS, Outcome.NO_CRASH}
    assert np.mean(episodes.outcome == Outcome.SUCCESS) > 0.8  # some need more than 17 actions
    again = rollout(world, robots, start_headings(world, METHODS["plaintext"]))
    np.testing.assert_array_equal(again.actions, episodes.actions)  # an episode begins without memory
