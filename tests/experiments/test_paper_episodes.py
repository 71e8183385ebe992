"""Episodes chosen to look at, and what their parties saw, on a small world without a renderer."""

import base64
import json

import numpy as np
import pytest
from flax import nnx

from ciphernav_jax.models import Navigator
from ciphernav_jax.navigation import features
from ciphernav_jax.navigation.methods import METHODS
from ciphernav_jax.navigation.rollout import Outcome, random_walk, rollout
from experiments.paper import episodes
from experiments.report import shown
from tests.navigation.conftest import make

WORLD = make(60, 5)
HEADINGS = np.asarray(WORLD.start_heading, np.int64)


@pytest.fixture(scope="module")
def driven():
    """Every robot takes the shortest path, but one that stops at once, and one that goes to and fro first."""
    actions = np.maximum(np.asarray(WORLD.actions, np.int64), 0)
    actions[0] = 0
    longest = int(np.argmin((actions > 0).sum(axis=1) + 99 * (np.arange(60) == 0)))
    forth = actions[longest, 0]
    back = {1: 2, 2: 1, 3: 4, 4: 3}[int(forth)]
    actions[longest] = [forth, back, *actions[longest, :-2]]
    return rollout(WORLD, lambda step, cells, headings: actions[:, step], HEADINGS), longest


def test_each_kind_has_the_longest_of_different_layouts(driven):
    episodes_driven, longer = driven
    chosen = episodes.choose(WORLD, episodes_driven)
    assert chosen["failure"] == [0]
    assert chosen["inefficient"] == [longer]
    assert 0 < len(chosen["success"]) <= episodes.SUCCESSES
    assert all(WORLD.detour[env] for env in chosen["success"])
    lengths = episodes_driven.lengths[chosen["success"]]
    assert lengths.tolist() == sorted(lengths.tolist(), reverse=True)
    assert len(set(WORLD.layout[chosen["success"]])) == len(chosen["success"])


@pytest.mark.parametrize("parties", [2, 5])
def test_what_is_written_of_an_episode_draws_it(driven, parties):
    env = episodes.choose(WORLD, driven[0])["success"][0]
    navigator = Navigator(nnx.Rngs(0))
    seen = features.encode(WORLD, METHODS["plaintext"], navigator.view_encoder, navigator.map_encoder)
    told = json.loads(json.dumps(episodes.watched(WORLD, driven[0], env, seen, parties, seed=0)))
    assert told["outcome"] == Outcome.SUCCESS.name.lower()
    frames = list(shown.frames(told, parties))
    assert len(frames) == len(told["actions"]) == told["shortest"]
    first = WORLD.views[WORLD.agent[env, 0, HEADINGS[env]]]
    np.testing.assert_array_equal(frames[0].tiles[0, "agent"], first)
    np.testing.assert_array_equal(
        shown.unpacked(told["views"]["top_left"]), WORLD.views[WORLD.cameras[env, 2]]
    )

    # Highest bytes of a small number's shares add up to 0 modulo 256, but for what the lower bytes carry.
    agents = [step["shares"]["agent"] for step in told["steps"]]
    for text in (*told["shares"].values(), *agents):
        share = np.frombuffer(base64.b64decode(text), np.uint8).reshape(parties, 32)
        left = (-share.sum(axis=0, dtype=int)) % 256
        assert left.max() < parties
    assert len(set(agents)) == len(agents)  # shared anew at each step


def test_a_random_walk_has_failures_of_one_sort():
    chosen = episodes.choose(WORLD, random_walk(WORLD, 0))
    assert len(chosen["failure"]) == episodes.FAILURES
