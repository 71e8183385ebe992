"""No mask hides two values: in whole runs of the project, and in every way to call, the ledger finds none."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import lax

import ciphernav_jax as cn
from ciphernav_jax.navigation import driving, folders, trainings
from ciphernav_jax.navigation.classifier import FreshClassifier
from ciphernav_jax.navigation.plain import EndToEnd
from ciphernav_jax.ring import keys
from ciphernav_jax.secret.rules import control_flow
from ciphernav_jax.world.grid import MAX_ACTIONS
from experiments.paper import variants
from tests.ledger import kept
from tests.navigation.conftest import Killed, killed_after_first, make, silent

pytestmark = pytest.mark.slow

KEY = keys.root(5)
X = np.arange(1.0, 7.0).reshape(3, 2)
FRESH = FreshClassifier(steps=2, batch=4, chunk=1)
share = partial(cn.share, parties=2)

# None of the project's own runs warns of a key that is given twice.
never_warned = pytest.mark.filterwarnings("error:the same key is given")


@never_warned
@pytest.mark.parametrize("parties", [2, 5])
def test_a_run_trains_goes_on_after_a_kill_and_drives_both_test_sets(tmp_path, parties):
    world, test, unseen = (make(5, seed) for seed in range(3))
    trainings.train_end_to_end(
        world, "plaintext", EndToEnd(epochs=1, batch=60), 0, tmp_path / "teacher", silent
    )
    _, teacher = folders.load(tmp_path / "teacher")
    train = partial(trainings.train_classifier, world, teacher, FRESH, 0, tmp_path / "secret")
    with kept() as ledger:
        with pytest.raises(Killed):
            train(killed_after_first, parties)
        train(silent, parties)
        config, model = folders.load(tmp_path / "secret")
        for dataset in (test, unseen):
            driving.drive(dataset, config, model, 0)
    assert ledger.reused() == []
    assert ledger.purposes == {"share", "step"}
    # A step and a count of right answers for each chunk, and the decisions of both drives, for each party.
    found = [s for s, hidden in ledger.hidden.items() if "step" in dict(next(iter(hidden.values())))]
    decisions = len(found) // parties - 2 * FRESH.steps
    assert len(found) % parties == decisions % 2 == 0
    assert 2 <= decisions <= 2 * MAX_ACTIONS


@never_warned
def test_a_variant_is_trained_with(monkeypatch):
    monkeypatch.setattr(variants, "TRUNCATIONS", (2, 1 << 10))
    with kept() as ledger:
        variants.trained(cn.Protocol(), FreshClassifier(batch=6), steps=3)
    assert ledger.reused() == []
    assert ledger.purposes == {"share", "step"}


def body(x):
    return jax.nn.relu(x * x - 1.0)


def while_on_call(x, n):
    return lax.fori_loop(0, n, lambda i, x: x * x * 0.5, x)


def branches(x, n):
    return lax.cond(n > 1, lambda x: x * x, lambda x: jnp.maximum(x, 0.0), x)


def rows():
    """Calls in every way: jitted, in loops, in branches, under vmap, differentiated."""
    step, on_call, branched = cn.secure(body), cn.secure(while_on_call), cn.secure(branches)
    split = partial(keys.derive, KEY)
    x = share(split("x"), X)
    step(split("once"), x)
    step(split("once"), x)  # the same again
    lax.scan(lambda x, key: (step(key, x), None), x, split("scan", np.arange(3)))
    lax.map(lambda each: step(each[0], share(*each)), (split("map", np.arange(3)), X))
    jax.vmap(lambda key, x: step(key, share(key, x)))(split("vmap", np.arange(3)), X)
    jax.vmap(lambda key: jax.vmap(lambda n: on_call(keys.derive(key, n), x, n))(jnp.arange(3)))(
        split("vmaps", np.arange(2))
    )
    on_call(split("on call"), x, jnp.int64(3))
    cn.secure(lambda x, n: lax.map(lambda row: while_on_call(row, n), x))(
        split("on call in a loop"), x, jnp.int64(2)
    )
    for n in range(3):
        branched(split("branch", n), x, jnp.int64(n))
        jax.jit(lambda n, key: lax.cond(n > 1, lambda: step(key, x), lambda: x))(n, split("outside", n))
    simulated = cn.simulate(lambda x: jnp.sum(body(x)), parties=2)
    jax.value_and_grad(lambda x: simulated(split("simulate"), x))(X)
    jax.vmap(jax.grad(lambda x: simulated(split("simulate, vmap"), x)))(X)


@never_warned
def test_every_way_to_call():
    with kept() as ledger:
        rows()
    assert ledger.reused() == []
    assert ledger.purposes == {"share", "step", "on call"}


@never_warned
def test_the_protocol_s_generator_is_that_of_shares_and_of_the_dealer_also_on_call():
    protocol = cn.Protocol(generator="chacha20")
    with kept() as ledger:
        x = share(KEY, X, protocol=protocol)
        cn.secure(while_on_call, protocol=protocol)(KEY, x, jnp.int64(2))
    assert ledger.reused() == []
    assert ledger.purposes == {"share", "step", "on call"}
    assert {generator for _, generator in ledger.hidden} == {"chacha20"}


# --- what is planted is found


def test_one_seed_for_every_use_is_found(tmp_path, monkeypatch):
    """Both test sets were driven with the same keys."""
    world, test = make(12, seed=0), make(5, seed=1)
    trainings.train_end_to_end(world, "map-only", EndToEnd(epochs=1, batch=60), 0, tmp_path, silent)
    config, model = folders.load(tmp_path)
    monkeypatch.setattr(driving, "key_of", lambda seed, what, how, dataset: keys.root(seed))
    with kept() as ledger:
        for dataset in (test, make(5, seed=2)):
            driving.drive(dataset, config, model, 0, 2)
    assert any("step" in found for found in ledger.reused())


def folded(key, *purpose):
    """Keys derived by numbers alone, as by hand."""
    for part in purpose:
        key = jax.random.fold_in(key, part if not isinstance(part, str) else 0)
    return key


def test_numbers_folded_in_by_hand_are_found(monkeypatch):
    """The mask of the public weights' first leaf was that of the first camera."""
    weights, camera = np.ones((4, 3)), np.arange(12.0).reshape(4, 3)
    with kept() as ledger:
        share(keys.derive(KEY, "weights"), [weights])
        share(keys.derive(KEY, "slot", "bottom_left"), camera)
    assert ledger.reused() == []
    monkeypatch.setattr(keys, "derive", folded)
    with kept() as ledger:
        share(keys.derive(KEY, "weights"), [weights])
        share(keys.derive(KEY, "slot"), [camera])
    (found,) = ledger.reused()
    assert found.count("share, words 0 to 11") == 2


@pytest.mark.parametrize("way", ["share and share", "step and step", "on call", "two shapes"])
def test_a_planted_reuse_is_found(way, monkeypatch):
    if way == "on call":
        take = control_flow.take_on_call
        monkeypatch.setattr(
            control_flow, "take_on_call", lambda seed, plan, _, *rest: take(seed, plan, 0, *rest)
        )
    with kept() as ledger:
        step, on_call = cn.secure(body), cn.secure(while_on_call)
        x = share(keys.derive(KEY, "x"), X)
        if way == "share and share":
            jax.jit(lambda x: (share(KEY, x), share(KEY, x + 1)))(X)
        elif way == "step and step":
            lax.fori_loop(0, 2, lambda i, carry: (step(carry[1], carry[0]), carry[1]), (x, KEY))
        elif way == "on call":
            on_call(KEY, x, jnp.int64(2))
        else:
            share(KEY, X[0])
            share(KEY, X)
    assert ledger.reused() != []
