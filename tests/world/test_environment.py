import subprocess
import sys
import warnings

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from ciphernav_jax.world import ENVIRONMENT_ID, register
from ciphernav_jax.world.environment import ObstacleWorld
from ciphernav_jax.world.grid import GOAL, map_code
from ciphernav_jax.world.poses import VIEWS
from ciphernav_jax.world.scenario import Obstacle, Scenario
from tests.patience import PATIENCE_S

# The ring, with a box east of the second cell; the goal is two cells south of the start.
WORLD = Scenario(11, 3, 10, (Obstacle(2, shape=0, colour=0, x=5.5, z=1.0, yaw=0.5),))


@pytest.fixture
def env():
    env = ObstacleWorld(render_mode="rgb_array")
    env.reset(seed=0, options={"scenario": WORLD})
    return env


def play(env, actions):
    for action in actions:
        result = env.step(np.int64(action))
    return result


@pytest.mark.parametrize("options", [{}, {"layout": (0, 9), "obstacles": 6, "start": "deterministic"}])
def test_check_env_has_no_complaint(options):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", message=".*no display.*")  # from trying render_mode="human"
        check_env(gymnasium.make(ENVIRONMENT_ID, **options).unwrapped)


def test_registering_twice_is_silent():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        register()
    assert gymnasium.spec(ENVIRONMENT_ID).entry_point == "ciphernav_jax.world.environment:ObstacleWorld"


def test_make_by_the_module_alone():
    program = f"import gymnasium; gymnasium.make('ciphernav_jax.world:{ENVIRONMENT_ID}').reset(seed=0)"
    subprocess.run([sys.executable, "-c", program], check=True, timeout=PATIENCE_S)


@pytest.mark.parametrize(
    ("actions", "outcome", "reward", "terminated", "truncated"),
    [
        ([2], "running", 0, False, False),
        ([2, 2, 0], "success", 1, True, False),
        ([4, 3, 2, 2, 0], "success", 1, True, False),
        ([2, 0], "no_crash", 0, True, False),
        ([1], "crash_wall", 0, True, False),  # off the grid
        ([4, 2], "crash_wall", 0, True, False),
        ([4, 4], "crash_obstacle", 0, True, False),
        ([2, 1] * 8, "running", 0, False, False),
        ([2, 1] * 8 + [2], "no_crash", 0, False, True),
        ([2, 1] * 7 + [2, 2, 0], "success", 1, True, False),  # the stop is the 17th action
        ([2, 1] * 7 + [2, 1, 0], "no_crash", 0, True, False),
    ],
)
def test_rules(env, actions, outcome, reward, terminated, truncated):
    _, *result, info = play(env, actions)
    assert result == [reward, terminated, truncated]
    assert info["outcome"] == outcome
    assert info["actions"] == len(actions)
    assert info["efficient"] == (outcome == "success" and len(actions) == 3)


def test_a_finished_episode_takes_no_action(env):
    play(env, [2, 2, 0])
    with pytest.raises(gymnasium.error.ResetNeeded, match="success"):
        env.step(0)


def test_a_crashed_agent_stays_and_faces_what_it_met(env):
    observation, *_, info = play(env, [4, 4])
    assert (info["cell"], info["heading"]) == (1, 3)
    np.testing.assert_array_equal(observation["map"], map_code(WORLD.walls, 1, WORLD.goal))


def test_observation_hides_obstacles_and_turns_with_the_agent(env):
    east, _ = env.reset(options={"scenario": WORLD})
    south, *_ = env.step(2)
    assert set(east) == {*VIEWS, "map"}
    assert set(east["map"]) == {0, 1, 2, 4}
    for camera in VIEWS[:4]:
        np.testing.assert_array_equal(east[camera], south[camera])
    assert (east["agent"] != south["agent"]).any()
    done, *_ = env.step(2)
    assert GOAL not in done["map"]


def test_same_seed_same_episodes():
    def episodes(seed):
        env = ObstacleWorld()
        first, _ = env.reset(seed=seed)
        return [first, env.scenario, env.reset()[0], env.scenario]

    a, b, other = episodes(5), episodes(5), episodes(6)
    assert (a[1], a[3]) == (b[1], b[3])
    assert a[1] != a[3]
    assert a[1] != other[1]
    for left, right in ((a[0], b[0]), (a[2], b[2])):
        for name, view in left.items():
            np.testing.assert_array_equal(view, right[name])


def test_two_environments_do_not_disturb_each_other():
    """MiniWorld keeps its rooms in one OpenGL list that all of a process's environments share."""
    one, two = ObstacleWorld(layout=10), ObstacleWorld(layout=11)
    first, _ = one.reset(seed=0)
    two.reset(seed=0)
    again, _ = one.reset(seed=0)
    np.testing.assert_array_equal(first["top_left"], again["top_left"])
    assert (two.reset(seed=0)[0]["top_left"] != first["top_left"]).any()


def test_options_of_the_constructor_and_of_reset():
    env = ObstacleWorld(start="deterministic", layout=3, obstacles=(7 - 5,), detour=None)
    for seed in range(6):
        env.reset(seed=seed)
        assert (env.scenario.layout, env.scenario.start_heading) == (3, 3)
        assert [thing.cell for thing in env.scenario.obstacles] == [2]
    env.reset(options={"layout": 9, "obstacles": None, "detour": True, "start": "random"})
    assert env.scenario.layout == 9
    assert env.scenario.detour


def test_harder_worlds_can_be_asked_for_and_solved():
    env = gymnasium.make(ENVIRONMENT_ID, layout=(8, 9), obstacles=5)
    for seed in range(8):
        env.reset(seed=seed)
        assert isinstance(env.unwrapped, ObstacleWorld)
        world = env.unwrapped.scenario
        assert world.layout in (8, 9)
        assert len(world.obstacles) == 5
        *_, info = play(env, (*world.path, 0))
        assert info["outcome"] == "success"
        assert info["efficient"]


@pytest.mark.parametrize(
    ("options", "message"),
    [({"layout": 12}, "layout=12"), ({"obstacles": 14}, "obstacles=14"), ({"start": "west"}, "neither")],
)
def test_wrong_options_are_named_when_it_is_made(options, message):
    with pytest.raises(ValueError, match=message):
        gymnasium.make(ENVIRONMENT_ID, **options)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"obstacle": (2,)}, "Unknown reset options"),
        ({"start": "west"}, "neither"),
        ({"layout": 12}, "layout=12"),
        ({"scenario": WORLD, "layout": 3}, "leaves nothing"),
    ],
)
def test_wrong_options_are_named(options, message):
    with pytest.raises(ValueError, match=message):
        ObstacleWorld().reset(options=options)


def test_render_modes(env):
    before = env.render()
    play(env, [2])
    assert before.shape == (480, 480, 3)
    assert (env.render() != before).any()
    with pytest.raises(ValueError, match="render_mode='text'"):
        ObstacleWorld(render_mode="text")


FORKED = """
import gymnasium, ciphernav_jax
make = lambda: gymnasium.make_vec(
    "ciphernav_jax/ObstacleWorld-v0", num_envs=2, vectorization_mode="async", vector_kwargs={"context": %r}
)
if __name__ == "__main__":
    env = make()
    env.reset(seed=0)
    env.close()
    print("done")
"""


@pytest.mark.parametrize("context", ["fork", "spawn"])
def test_processes_that_are_forked_say_so_and_those_started_afresh_work(tmp_path, context):
    """A fork would wait for ever in its first reset."""
    script = tmp_path / "script.py"
    script.write_text(FORKED % context)
    done = subprocess.run(
        [sys.executable, str(script)], capture_output=True, text=True, timeout=PATIENCE_S, check=False
    )
    if context == "spawn":
        assert done.stdout == "done\n", done.stderr
    else:
        assert done.returncode != 0
        assert 'vector_kwargs={"context": "spawn"}' in done.stderr
