"""What a call costs: against formulas derived by hand, and against messages that two processes exchange."""

import json
import math
import os
import socket
import subprocess
import sys
from functools import partial
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import ciphernav_jax as cn
from ciphernav_jax import ring
from ciphernav_jax.parties.messages import Opening
from ciphernav_jax.secret import view
from ciphernav_jax.secret.costs import Cost

from ..patience import PATIENCE_S
from .message_process import PARTIES, calls

pytestmark = pytest.mark.newest_jax

ROOT = Path(__file__).parents[2]
ROWS, WIDTH, HIDDEN, OUT = 9, 6, 8, 3


def shares(*shapes, parties=2):
    """Secrets that have a shape and no value."""
    arrays = [jax.ShapeDtypeStruct(shape, jnp.float32) for shape in shapes]
    return jax.eval_shape(partial(cn.share, parties=parties), jax.random.key(0), arrays)


def cost(function, *shapes, parties=2):
    return cn.cost(cn.secure(function), *shares(*shapes, parties=parties))


def columns(n):
    """Words for one bit of each of n values."""
    return -(-n // 64)


def relu_sent(n):
    """x under its mask; then for each pair of neighbours in a tree over 32 nodes the one carry-in and two
    others of an AND, only one other at its root; and the bit.
    """
    return n + columns(n) * (3 * (16 + 8 + 4 + 2) + 2 + 1)


def relu_uniform(n):
    """A mask; two words for the one factor of each AND and a third for its other, but at the root; a bit."""
    return n + columns(n) * (3 * (16 + 8 + 4 + 2) + 2 + 1)


def relu_dealt(n, shift):
    """A mask's parts, bits and pairs; the product of each AND, twice where it has two others; a bit as a
    number; its product with the mask, or with both parts of a truncated one.
    """
    parts = 2 if shift else 0
    products = 2 if shift else 1
    return n * (parts + 1 + products) + columns(n) * (64 + 31 + 2 * (16 + 8 + 4 + 2) + 1)


@pytest.mark.parametrize("parties", [2, 3, 8])
def test_relu(parties):
    n = 70
    found = cost(jax.nn.relu, (n,), parties=parties)
    assert (found.parties, found.rounds, found.messages) == (parties, 7, 7 * (parties - 1))
    assert found.bytes_sent == 8 * (parties - 1) * relu_sent(n)
    assert found.bytes_dealt == 16 * parties + 8 * relu_dealt(n, shift=0)
    assert found.uniform_words == parties * relu_uniform(n) + (parties - 1) * relu_dealt(n, shift=0)
    assert not found.unbounded
    assert found.ideal == 0


def mlp(x, first, second):
    return jax.nn.relu(x @ first) @ second


def test_a_network_layer_by_layer():
    found = cost(mlp, (ROWS, WIDTH), (WIDTH, HIDDEN), (HIDDEN, OUT), parties=3)
    n, factors = ROWS * HIDDEN, ROWS * WIDTH + WIDTH * HIDDEN + HIDDEN * OUT
    # All factors but the hidden layer are opened at once; the last product is truncated.
    assert found.rounds == 1 + 7 + 1 + 1
    assert found.bytes_sent == 8 * 2 * (factors + relu_sent(n) + n + ROWS * OUT)
    triples = ROWS * HIDDEN + ROWS * OUT
    assert found.bytes_dealt == 16 * 3 + 8 * (triples + relu_dealt(n, shift=20) + 2 * ROWS * OUT)

    products, relus, output = found.by_primitive
    assert [row.name for row in found.by_primitive] == ["dot_general", "max", "output"]
    assert (products.openings, products.rounds, products.words) == (4, 2, factors + n)
    assert (relus.openings, relus.rounds, relus.words) == (7, 7, relu_sent(n))
    assert (output.openings, output.rounds, output.words) == (1, 1, ROWS * OUT)
    assert relus.bytes_dealt == 8 * relu_dealt(n, shift=20)
    names = {row.name: row.words for row in found.by_protocol if row.openings}
    assert names == {"open_masked": factors + n, "relu": relu_sent(n), "probabilistic": ROWS * OUT}


def training_step(weights, x, y):
    def loss(weights):
        return jnp.sum((mlp(x, *weights) - y) ** 2)

    value, gradient = jax.value_and_grad(loss)(weights)
    return value, jax.tree.map(lambda w, g: w - 2.0**-8 * g, weights, gradient)


@pytest.fixture(scope="module")
def training():
    first, second, x, y = shares((WIDTH, HIDDEN), (HIDDEN, OUT), (ROWS, WIDTH), (ROWS, OUT), parties=5)
    return cn.cost(cn.secure(training_step), (first, second), x, y)


def test_every_part_is_in_one_row_of_each_grouping(training):
    for rows in (training.by_protocol, training.by_primitive):
        assert sum(row.bytes_sent for row in rows) == training.bytes_sent
        assert 16 * 5 + sum(row.bytes_dealt for row in rows) == training.bytes_dealt
        assert "(none)" not in [row.name for row in rows]
    assert 16 * 5 + sum(row.bytes_dealt for row in training.by_request) == training.bytes_dealt
    assert {row.name for row in training.by_request} >= {"Mask", "AndTriple", "SharedBits", "Product"}
    rounds = [r for opening in training.openings for r in opening.rounds]
    assert set(rounds) == set(range(1, training.rounds + 1))


def test_the_table_shows_the_totals(training):
    text = str(training)
    assert f"5 parties: {training.rounds} rounds, {training.bytes_sent / 1e3:.3g} kB sent." in text
    assert f"the dealer sends {training.bytes_dealt / 1e3:.3g} kB to all" in text
    for row in (*training.by_primitive, *training.by_protocol):
        assert f" {row.name} " in text
        assert f"{row.words:,}" in text


def test_the_dictionary_is_json(training):
    loaded = json.loads(json.dumps(training.as_dict()))
    assert loaded["rounds"] == training.rounds
    assert sum(row["bytes_sent"] for row in loaded["by_primitive"]) == loaded["bytes_sent"]
    assert loaded["seconds"]["WAN"] == training.seconds(cn.WAN)


def test_seconds_are_rounds_of_latency_and_bytes_at_the_rate(training):
    network = cn.Network("slow", latency_s=0.5, bits_per_s=1000)
    assert training.seconds(network) == training.rounds * 0.5 + training.bytes_sent * 8 / 1000
    assert training.seconds(cn.LAN) < training.seconds(cn.WAN)


def test_independent_openings_share_a_round():
    together = cost(lambda x, y: (x * y, x * x), (4,), (4,))
    one_after_the_other = cost(lambda x, y: x * y * x, (4,), (4,))
    assert (together.rounds, one_after_the_other.rounds) == (2, 4)


def body(carry, row):
    return jax.nn.relu(carry * row)


def test_a_loop_s_randomness_counts_under_what_asks_for_it():
    once = cost(body, (6,), (6,))

    def loops(x):
        def again(carry, row):
            return jax.lax.fori_loop(0, 3, lambda i, c: body(c, row), carry), None

        return jax.lax.scan(again, x[0], x)[0]

    looped = cost(loops, (4, 6))
    for grouping in ("by_request", "by_primitive", "by_protocol"):
        dealt = {row.name: row.bytes_dealt for row in getattr(once, grouping)}
        assert {row.name: row.bytes_dealt for row in getattr(looped, grouping)} == {
            name: 4 * 3 * size for name, size in dealt.items()
        }
    assert looped.bytes_on_call == 0


def test_a_dealer_on_call_deals_a_body_for_each_iteration():
    once = cost(body, (6,), (6,))
    n = jax.ShapeDtypeStruct((), jnp.int64)

    def loop(x, n):
        return jax.lax.fori_loop(0, n, lambda i, c: body(c, x), x)

    def loop_in_a_scan(x, n):
        return jax.lax.map(lambda row: loop(row, n), x)

    def scan_in_a_loop(x, n):
        return jax.lax.fori_loop(0, n, lambda i, c: jax.lax.map(lambda row: body(row, row + 1), c), x)

    for function, shape, times in (
        (loop, (6,), 1),
        (loop_in_a_scan, (4, 6), 4),
        (scan_in_a_loop, (4, 6), 4),
    ):
        found = cn.cost(cn.secure(function), *shares(shape), n)
        assert found.bytes_on_call == times * sum(row.bytes_dealt for row in once.by_request)
        assert [(row.name, row.bytes_dealt) for row in found.by_request] == [("OnCall", 0)]
        assert f"on call for it, and sends {found.bytes_on_call / 1e3:.3g} kB" in str(found)


def test_what_is_public_or_local_costs_nothing():
    found = cost(lambda x: 2 * x[::2] + jnp.sum(x) - jnp.exp(jnp.ones(4, x.dtype)), (8,))
    assert (found.rounds, found.bytes_sent, found.bytes_dealt, found.uniform_words) == (0, 0, 0, 0)


def test_shapes_cost_what_their_values_do():
    rng = np.random.default_rng(0)
    drawn = [rng.normal(size=shape).astype(np.float32) for shape in [(4, 3), (3, 2)]]
    step = cn.secure(lambda x, w, scale: scale * jax.nn.relu(x @ w))
    x, w = cn.share(jax.random.key(0), drawn, parties=3)
    assert cn.cost(step, x, w, np.float32(2)) == cn.cost(
        step, *shares((4, 3), (3, 2), parties=3), jax.ShapeDtypeStruct((), jnp.float32)
    )


def opening(collective="open_sum", rounds=(1,), per_iteration=False):
    return Opening(collective, "relu", "max", (5,), np.dtype(np.uint64), rounds, per_iteration)


def test_an_ideal_variant_is_named_and_not_counted():
    found = Cost(3, (opening("ideal_sum", (1, 2)), opening()), (), 0)
    assert (found.rounds, found.bytes_sent, found.ideal) == (1, 80, 2)
    assert found.by_primitive[0].openings == 1
    assert "ideal: 2 openings by a trusted third party, not a protocol" in str(found)
    assert "ideal" not in str(Cost(3, (opening(),), (), 0))


def test_a_loop_of_unknown_length_is_said_to_be_one():
    found = Cost(2, (opening(per_iteration=True),), (), 0)
    assert found.unbounded
    assert "1 round or more" in str(found)
    assert "while" in str(found)


def test_what_secure_has_not_made_is_refused():
    for use in (cn.cost, cn.transcript):
        with pytest.raises(TypeError, match=r"made by secure\(f\), got function"):
            use(lambda x: x)


def test_what_the_step_refuses_the_cost_refuses():
    with pytest.raises(NotImplementedError, match="cannot evaluate `exp`"):
        cost(jnp.exp, (3,))


@pytest.fixture(scope="module")
def exchanged(tmp_path_factory):
    """The folder into which both processes have written their shares and counts."""
    out = tmp_path_factory.mktemp("messages")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = str(free.getsockname()[1])
    # What is compiled runs once: spend no time on making it fast.
    environment = os.environ | {"XLA_FLAGS": "--xla_backend_optimization_level=0"}
    processes = [
        subprocess.Popen(
            [sys.executable, "-m", "tests.secret.message_process", str(out), str(rank), port],
            cwd=ROOT,
            stderr=subprocess.PIPE,
            text=True,
            env=environment,
        )
        for rank in range(PARTIES)
    ]
    try:
        errors = [process.communicate(timeout=PATIENCE_S)[1] for process in processes]
    finally:
        for process in processes:
            process.kill()
    assert [process.returncode for process in processes] == [0] * PARTIES, "\n".join(errors)
    return out


@pytest.mark.slow
@pytest.mark.parametrize("name", calls())
def test_two_processes_send_as_many_messages_and_bytes(name, exchanged):
    step, _, args = calls()[name]
    expected = cn.cost(step, *args)
    for rank in range(PARTIES):
        counts = json.loads((exchanged / f"counts{rank}.json").read_text())[name]
        assert counts == {"messages": expected.messages, "bytes": expected.bytes_sent}


@pytest.mark.slow
@pytest.mark.parametrize("name", calls())
def test_two_processes_compute_the_simulation_s_shares(name, exchanged):
    step, key, args = calls()[name]
    for i, shares in enumerate(map(np.asarray, jax.tree.leaves(step(key, *args)))):
        for rank in range(PARTIES):
            own = np.load(exchanged / f"{name}{rank}.npz")[f"arr_{i}"]
            np.testing.assert_array_equal(own, shares[rank : rank + 1])


def draws(step, key, args, monkeypatch):
    """How many words each stream has that a call draws."""
    drawn = []
    draw = ring.draw

    def noted(key, shapes, generator="threefry"):
        drawn.append(sum(map(math.prod, shapes)))
        return draw(key, shapes, generator)

    with monkeypatch.context() as patched:
        patched.setattr(ring, "draw", noted)
        jax.eval_shape(lambda key, args: step.call(step.given(*args)).run(key)[0], key, args)
    return drawn


@pytest.mark.slow
@pytest.mark.parametrize(("truncation", "parties"), [("probabilistic", 2), ("nearest", 3), ("wrap-count", 5)])
def test_a_party_draws_all_that_it_holds_and_is_not_sent(truncation, parties, monkeypatch):
    protocol = cn.Protocol(truncation=truncation)
    secrets = shares((ROWS, WIDTH), (WIDTH, HIDDEN), (HIDDEN, OUT), parties=parties)
    step = cn.secure(mlp, protocol=protocol)
    found = cn.cost(step, *secrets)
    drawn = draws(step, jax.random.key(0), secrets, monkeypatch)
    held = jax.eval_shape(view(step), jax.random.key(0), *secrets)[1].dealt
    words = sum(math.prod(x.shape[1:]) for x in held)
    needed = [words - (sent - 16) // 8 for sent in found.bytes_dealt_to]
    assert found.uniform_words == sum(needed)
    assert drawn == [max(needed)]  # for all parties at once
    assert max(found.bytes_dealt_to) < 2 * min(found.bytes_dealt_to)  # by turns
