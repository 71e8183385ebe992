import dataclasses

import numpy as np
import pytest

from ciphernav_jax.navigation.methods import METHODS
from ciphernav_jax.navigation.metrics import overall, tally
from ciphernav_jax.navigation.rollout import Outcome, careful, random_walk, rollout
from ciphernav_jax.navigation.samples import start_headings
from ciphernav_jax.world.grid import WALLS

LAYOUT = 11  # ring only


def script(*actions):
    """A policy that takes these actions whatever it sees, and then waits to be done."""
    return lambda step, cells, headings: np.full(len(cells), actions[step] if step < len(actions) else 1)


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
    def oracle(step, cells, headings):
        return np.maximum(world.actions[:, step], 0).astype(np.int64)

    episodes = rollout(world, oracle, start_headings(world, METHODS["plaintext"]))
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


def by_view(answers):
    """A policy that answers by heading alone."""
    return lambda question, cells, headings: np.array([answers[heading] for heading in headings.tolist()])


UP, DOWN, LEFT, RIGHT = range(4)


@pytest.mark.parametrize(
    ("answers", "outcome", "length"),
    [
        ({RIGHT: 0, UP: 4, DOWN: 4, LEFT: 4}, Outcome.SUCCESS, 3),  # stops too early: asks with another view
        ({RIGHT: 1, UP: 4, DOWN: 4, LEFT: 4}, Outcome.SUCCESS, 3),  # off the grid
        (
            {RIGHT: 4, UP: 4, DOWN: 4, LEFT: 4},
            Outcome.SUCCESS,
            3,
        ),  # does not stop on the goal: it does itself
        ({RIGHT: 2, DOWN: 2, LEFT: 2, UP: 2}, Outcome.CRASH_OBSTACLE, 2),  # sees no obstacle itself
        ({RIGHT: 0, DOWN: 0, LEFT: 0, UP: 0}, Outcome.NO_CRASH, 1),  # no view helps
    ],
)
def test_a_careful_robot_uses_what_it_knows(ring, answers, outcome, length):
    episodes = rollout(ring, careful(by_view(answers), ring), np.array([RIGHT]))
    assert episodes.outcome.tolist() == [outcome]
    assert episodes.lengths.tolist() == [length]


def test_a_careful_robot_does_not_go_in_circles_and_asks_no_question_twice(ring):
    asked = []

    def back_and_forth(question, cells, headings):
        asked.append((question, int(cells[0]), int(headings[0])))
        if headings[0] == UP:
            return np.array([4])
        return np.array([4 if cells[0] == 0 else 3])

    plain = rollout(ring, back_and_forth, np.array([RIGHT]))
    assert plain.outcome.tolist() == [Outcome.NO_CRASH]
    asked.clear()
    episodes = rollout(ring, careful(back_and_forth, ring), np.array([RIGHT]))
    assert episodes.outcome.tolist() == [Outcome.SUCCESS]
    assert len({question for question, *_ in asked}) == len(asked)
