"""A process that compiles many functions on secrets lives: programs are let go before memory maps run out."""

import logging
import threading

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import ciphernav_jax as cn
from ciphernav_jax.secret import compiled

pytestmark = [
    pytest.mark.newest_jax,
    pytest.mark.skipif(not compiled.MAPS.exists(), reason="no memory maps to count here"),
]

X = np.arange(4.0)
KEY = jax.random.key(0)


@pytest.fixture(scope="module")
def secret():
    return cn.share(KEY, X, parties=2)


@pytest.fixture(autouse=True)
def alone(monkeypatch):
    """The programs of other tests are not looked at."""
    monkeypatch.setattr(compiled, "_by_last_call", type(compiled._by_last_call)())
    monkeypatch.setattr(compiled, "_kept", 0)


@pytest.fixture
def allow(tmp_path, monkeypatch):
    """allow(n): a process may have n memory maps."""
    file = tmp_path / "max_map_count"
    monkeypatch.setattr(compiled, "ALLOWED", file)
    return lambda maps: file.write_text(f"{maps}\n")


@pytest.fixture
def counts(monkeypatch):
    """A list of what `_count` answers, the last one again and again; and of how often it was asked."""
    answers, asked = [0], []

    def count():
        asked.append(answers.pop(0) if len(answers) > 1 else answers[0])
        return asked[-1]

    monkeypatch.setattr(compiled, "_count", count)
    return answers, asked


def scaled(factor):
    step = cn.secure(lambda x: x * factor)

    def check(secret):
        np.testing.assert_array_equal(cn.reveal(step(KEY, secret)), factor * X)

    return check


def test_what_was_called_longest_ago_is_let_go_first(secret, allow, counts, caplog):
    answers, asked = counts
    steps = [scaled(2.0**n) for n in range(4)]
    for step in [*steps, steps[0]]:
        step(secret)
    answers[:] = [100, 75, 50]  # before, and after each quarter of the programs
    allow(180)
    scaled(16.0)(secret)
    assert [record.levelno for record in caplog.records] == [logging.WARNING]
    assert "100 memory maps" in caplog.text
    again = []
    for step in steps:
        before = len(asked)
        step(secret)
        again.append(len(asked) > before)
    assert again == [False, True, True, False]


def test_nothing_is_let_go_while_half_of_the_maps_are_free(secret, allow, counts, caplog):
    answers, asked = counts
    answers[:] = [90]
    allow(180)
    step = scaled(2.0)
    for _ in range(3):
        step(secret)
    assert len(asked) == 1  # counted where it was compiled, and no more
    assert not caplog.records


def test_maps_that_are_not_of_programs_are_not_counted_against_them(secret, allow, counts, caplog):
    answers, _ = counts
    allow(180)
    for taken, factor, times in ((120, 2.0, 1), (150, 4.0, 1), (151, 8.0, 2)):  # 150: half of the other 60
        answers[:] = [taken, 120]
        scaled(factor)(secret)
        assert len(caplog.records) == times


PROTOCOL = cn.Protocol(multiplication="ideal", truncation="ideal")  # compiles fast
ONE = cn.secure(lambda x: x * x, protocol=PROTOCOL)


def by_itself(factor):
    step = cn.secure(lambda x: factor * x * x, protocol=PROTOCOL)
    return lambda secret: cn.reveal(step(KEY, secret))


def part_of_another(factor):
    # The same function on secrets each time: it is traced once, and compiled again and again.
    return jax.jit(lambda secret: factor * cn.reveal(ONE(KEY, secret)))


def through_the_protocol(factor):
    simulated = cn.simulate(lambda x: factor * jnp.sum(x**3) / 3, parties=2, protocol=PROTOCOL)
    gradient = jax.jit(jax.grad(lambda x: simulated(KEY, x)))
    return lambda _: gradient(X)


@pytest.mark.parametrize("of_its_own", [by_itself, part_of_another, through_the_protocol])
def test_a_process_lives_with_few_maps(of_its_own, secret, allow, caplog):
    functions = [of_its_own(float(factor)) for factor in range(6)]
    functions[0](secret)
    before = compiled._count()
    functions[1](secret)
    each = compiled._count() - before
    assert each > 10  # otherwise it says nothing
    allow(2 * (before + 2 * each))
    for factor, function in enumerate(functions[2:], 2):
        np.testing.assert_allclose(function(secret), factor * X**2, atol=1e-4)
        assert compiled._count() < before + 4 * each
    assert caplog.records


def test_what_runs_is_kept_until_it_ends(secret, allow, counts, caplog):
    started, finish, results = threading.Event(), threading.Event(), []

    def wait(x):
        started.set()
        assert finish.wait(600)
        return x

    def runs(secret):
        x = cn.reveal(ONE(KEY, secret))
        return cn.reveal(ONE(KEY, cn.share(KEY, jax.pure_callback(wait, x, x), parties=2)))

    running = threading.Thread(target=lambda: results.append(jax.jit(runs)(secret)))
    running.start()
    try:
        assert started.wait(600)
        counts[0][:] = [100]
        allow(100)
        scaled(2.0)(secret)
        assert caplog.records
    finally:
        finish.set()
        running.join()
    np.testing.assert_allclose(results[0], X**4, atol=1e-4)


def test_where_no_maps_can_be_counted_nothing_is_done(secret, tmp_path, monkeypatch, caplog):
    monkeypatch.setattr(compiled, "MAPS", tmp_path / "none")
    scaled(2.0)(secret)
    assert not caplog.records
