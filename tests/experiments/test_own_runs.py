"""The attacks on the project's own runs find nothing in them, and find masks that are used twice."""

from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from ciphernav_jax.learning import Model, fit, fitting
from ciphernav_jax.navigation import classifier, driving, policies, trainings
from ciphernav_jax.navigation.classifier import FreshClassifier
from ciphernav_jax.navigation.features import Features
from ciphernav_jax.navigation.folders import Trained
from ciphernav_jax.navigation.owners import CAMERAS, SLOTS
from ciphernav_jax.navigation.samples import Samples
from ciphernav_jax.ring import keys
from ciphernav_jax.secret import is_secret, share
from ciphernav_jax.world.grid import CELLS
from experiments.paper import attack, exact, own_runs, reconstruction
from experiments.paper.exact import Sight

pytestmark = pytest.mark.slow

SEED, COUNT = 0, 5
RECIPE = FreshClassifier(steps=1, batch=4)


def uniform(seed, *shape):
    return np.random.default_rng(seed).integers(2**64, size=shape, dtype=np.uint64)


# --- the exact attack

VALUES = np.array([5, 2**64 - 7, 9], np.uint64)
OTHERS = np.array([11, 12, 13], np.uint64)
MASK = uniform(0, 3)
HIDDEN = Sight("hidden", VALUES - MASK, VALUES)


@pytest.mark.parametrize(
    ("sight", "expected"),
    [
        (Sight("other", uniform(1, 3), OTHERS), {}),
        (Sight("other", uniform(1, 3)), {}),
        (Sight("other", OTHERS - MASK, OTHERS), {"compared": 3}),
        (Sight("other", MASK - OTHERS, np.zeros_like(MASK) - OTHERS), {"compared": 3}),
        (Sight("other", OTHERS - MASK, OTHERS, public=True), {"read": 3}),
        (Sight("other", MASK + OTHERS, OTHERS, public=True), {"read": 3}),
        (Sight("other", MASK), {"read": 3}),
        (Sight("other", np.zeros_like(MASK) - MASK), {"read": 3}),
        (Sight("other", (VALUES - MASK)[1:]), {"repeated": 2}),
    ],
)
def test_what_two_words_tell(sight, expected):
    found = exact.attack([HIDDEN, sight])["hidden"]
    assert found == {"words": 3, "read": 0, "compared": 0, "repeated": 0} | expected


def test_what_stands_unmasked_is_read():
    assert exact.attack([Sight("bare", VALUES, VALUES)])["bare"]["read"] == 3


# --- the runs

WORLD = SimpleNamespace(meta={"split": "train", "seed": 0})
TESTS = {
    name: SimpleNamespace(meta={"split": "test", "seed": i}) for i, name in enumerate(("test", "unseen"))
}
CONFIG = {"method": "secret", "seed": SEED}


def random_features(seed):
    rng = np.random.default_rng(seed)
    return Features(
        cameras=tuple(rng.normal(size=(COUNT, 32)).astype(np.float32) for _ in CAMERAS),
        views=rng.normal(size=(9, 32)).astype(np.float32),
        view_index=rng.integers(9, size=(COUNT, CELLS, 4)).astype(np.int32),
        maps=rng.normal(size=(12, CELLS, CELLS, 128)).astype(np.float32),
        layout=rng.integers(12, size=COUNT).astype(np.uint8),
        goal=rng.integers(CELLS, size=COUNT).astype(np.uint8),
    )


@pytest.fixture(scope="module", autouse=True)
def small_classifier():
    """One layer, as four and an arg max compile for a minute; its weights are the first and only leaf."""
    kernel = np.random.default_rng(4).normal(size=(288, 5)).astype(np.float32)

    def predict(params, slots):
        return jax.nn.relu(jnp.concatenate(slots, axis=-1) @ params["kernel"])

    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(classifier, "initial", lambda seed: {"kernel": kernel})
        patched.setattr(classifier, "CLASSIFIER", Model(predict, 5))
        patched.setattr(policies, "best_action", predict)
        yield
    own_runs.observed_step.cache_clear()
    own_runs.observed_decision.cache_clear()


@pytest.fixture(scope="module")
def samples():
    rng = np.random.default_rng(3)
    return Samples(*(rng.integers(n, size=8) for n in (COUNT, CELLS, 4, CELLS, 5)))


@pytest.fixture(scope="module")
def features():
    return [random_features(seed) for seed in range(3)]


def runs_of(parties, features, samples):
    """A training and the drives of both test sets, with the keys that they derive."""
    key = trainings.training_key(CONFIG, WORLD)
    runs = {"training": own_runs.training(key, features[0], samples, RECIPE, SEED, parties, steps=1)}
    weights = classifier.initial(1)
    for (name, dataset), seen in zip(TESTS.items(), features[1:], strict=True):
        key = driving.driving_key(dataset, CONFIG, Trained({}, (), weights), SEED, parties)
        runs[name] = own_runs.drive(key, weights, seen, np.zeros(COUNT, np.int64), parties)
    return runs


def found_by(runs, coalition):
    return exact.attack(own_runs.sights(runs, coalition))


def total(found, what):
    return sum(of[what] for of in found.values())


def once_as_by_hand(derive):
    """The old derivation: one key for all runs of a seed, and the number 0 for the weights, for the first
    camera, and for the first leaf of what is shared.
    """
    ((first, _), *_) = jax.tree_util.tree_leaves_with_path((classifier.initial(0),))
    zero = {"weights", CAMERAS[0], jax.tree_util.keystr(first), ""}
    skipped = {"training", "driving", "slot", "share"}

    def derived(key, *purpose):
        for part in purpose:
            if not isinstance(part, str):
                key = derive(key, part)
            elif part not in skipped and not part.startswith("{"):
                key = derive(key, 0 if part in zero else part)
        return key

    return derived


@pytest.mark.parametrize("parties", [2, 5])
def test_a_mask_used_twice_is_found_and_in_the_project_s_runs_there_is_none(
    parties, features, samples, monkeypatch
):
    runs = runs_of(parties, features, samples)
    coalitions = own_runs.coalitions(parties)
    assert [len(coalition) for coalition in coalitions] == [parties - 1] * parties
    for coalition in coalitions:
        found = found_by(runs, coalition)
        assert {name.partition(",")[0] for name in found} == {"training", *TESTS}
        assert total(found, "words") > 10_000
        assert total(found, "read") == total(found, "compared") == total(found, "repeated") == 0

    monkeypatch.setattr(keys, "derive", once_as_by_hand(keys.derive))
    runs = runs_of(parties, features, samples)
    for coalition in coalitions:
        found = found_by(runs, coalition)
        # Party 0 holds what the others' words leave. Who adds theirs up without it sees the same word twice.
        plain, first = ("read", "compared"), found["test, bottom_left"]
        assert [first[what] for what in plain] == ([COUNT * 32] * 2 if 0 in coalition else [0, 0])
        assert first["repeated"] == (0 if 0 in coalition else COUNT * 32)
        assert found["test, top_left"]["compared"] == (COUNT * 32 if 0 in coalition else 0)
        assert found["training, bottom_left"]["read"] == 0
        # Both drives are dealt for with one key.
        assert found["test, view 0"]["repeated"] == found["unseen, view 0"]["repeated"] > 0


def test_what_is_attacked_is_what_training_shares(features, samples, monkeypatch):
    class Begun(Exception):
        pass

    def begin(key, state, data, *_):
        raise Begun(state, data)

    monkeypatch.setattr(fitting, "_run", SimpleNamespace(lower=begin))
    key = trainings.training_key(CONFIG, WORLD)
    with pytest.raises(Begun) as begun:
        fit(
            classifier.CLASSIFIER,
            classifier.initial(SEED),
            classifier.table(features[0], samples, 2),
            RECIPE,
            key,
            seed=SEED,
            parties=2,
        )
    run = own_runs.training(key, features[0], samples, RECIPE, SEED, 2, steps=1)
    expected = [x.shares for x in jax.tree.leaves(begun.value.args, is_leaf=is_secret)]
    state = [run.public[name] for name in ("weights kernel", "velocity kernel", "loss")]
    attacked = [secret.shares for secret in (*state, *run.secret.values())]
    assert len(expected) == len(attacked) == 3 + len(SLOTS) + 1
    for one, other in zip(expected, attacked, strict=True):
        np.testing.assert_array_equal(one, other)


def test_attackers_learn_from_equal_rows_of_two_data_sets(monkeypatch):
    for module in (own_runs, reconstruction):
        monkeypatch.setattr(module, "ATTACKERS", {"linear": attack.ATTACKERS["linear"]})
    coins = np.random.default_rng(5).permutation(np.arange(400) < 200)
    truth = np.stack([coins] * len(CAMERAS), axis=1)

    def run(key, count, values):
        shared = {camera: share(keys.derive(key, camera), values, parties=2) for camera in CAMERAS}
        assert len(values) == count
        return own_runs.Seen({}, shared, [])

    told = np.broadcast_to(np.where(coins, 1, -1)[:, None], (400, 3)).astype(np.float32)
    one, other = run(keys.root(0), 400, told), run(keys.root(1), 410, np.zeros((410, 3), np.float32))
    for coalition in own_runs.coalitions(2):
        words = own_runs.rows(one, other, coalition)
        assert words.shape == (400, 3 * 4 * 3)
        assert own_runs.learned(words, truth, 0)["linear"]["top_left"]["accuracy"] < 70
    reused = run(keys.root(0), 410, np.zeros((410, 3), np.float32))
    words = own_runs.rows(one, reused, [0])
    assert own_runs.learned(words, truth, 0)["linear"]["top_left"]["accuracy"] == 100
