"""Where range and resolution are lost, beside a float64 evaluation: the line, how much, and nothing else."""

import json
from pathlib import Path

import flax.linen as nn
import jax
import jax.numpy as jnp
import numpy as np
import optax
import pytest
from jax import lax

import ciphernav_jax as cn
from experiments import primitives
from experiments.work import works

KEY = jax.random.key(1)
BIG = np.full(4, 3000.0)  # its square does not fit
SOURCE = Path(__file__).read_text().splitlines()


def line(mark):
    """The number of the line that ends in this mark."""
    (number,) = (i for i, text in enumerate(SOURCE, start=1) if text.endswith(f"# {mark}"))
    return number


def shared(x, parties=2, **variants):
    return cn.share(jax.random.key(0), x, parties=parties, protocol=cn.Protocol(**variants))


def report_of(function, *args, parties=2, strict=False, **variants):
    protocol = cn.Protocol(**variants)
    args = [shared(x, parties, **variants) if isinstance(x, np.ndarray) else x for x in args]
    return cn.validate(cn.secure(function, protocol=protocol), strict=strict)(KEY, *args)[1]


# --- lines that lose range ------------------------------------------------------------------------------


def straight(x, n):
    x = x - 1.0
    y = x * x  # range: straight
    return y * 0.25


def in_a_scan(x, n):
    def body(c, _):
        d = c * 40.0
        return d, jnp.sum(d * d)  # range: scan

    return lax.scan(body, x, length=2)


def in_a_later_iteration(x, n):
    def body(x, _):
        y = x * 2.0
        y = y * y  # range: iteration
        return y * x, None

    return lax.scan(body, x, length=4)[0]  # 2, 32, 2^17, 2^53: each line would be lost in the end


def in_a_while(x, n):
    def body(state):
        i, c = state
        return i + 1, c * c * c  # range: while

    return lax.while_loop(lambda state: state[0] < n, body, (0, x))[1]


def in_a_branch(x, n):
    def taken(x):
        return x @ x  # range: cond

    return lax.cond(n > 2, taken, jnp.sum, x)


@jax.jit
def jitted(x):
    return jnp.where(x > 0, x * x, x)  # range: jit


def in_a_jitted_function(x, n):
    return jitted(x) + 1.0


def in_a_library(x, n):
    return jnp.sum(optax.squared_error(x))  # range: library


def in_a_jitted_library(x, n):
    return jnp.vdot(x, x)  # range: jitted library


def in_a_flax_layer(x, n):
    layer = nn.Dense(2)
    return layer.apply({"params": {"kernel": x.reshape(2, 2), "bias": x[:2]}}, x[:2])  # range: flax


def backwards(x, n):
    def loss(x):
        y = x * x  # range: gradient
        return 2.0**12 * jnp.sum(jnp.square(y * 2.0**-8))

    return jax.grad(loss)(x)


PLANTED = {
    "straight": straight,
    "scan": in_a_scan,
    "iteration": in_a_later_iteration,
    "while": in_a_while,
    "cond": in_a_branch,
    "jit": in_a_jitted_function,
    "library": in_a_library,
    "jitted library": in_a_jitted_library,
    "flax": in_a_flax_layer,
    "gradient": backwards,
}
FIRST_FITS = {
    "iteration": np.full(2, 2.0),
    "scan": BIG / 50,
    "while": BIG / 20,
    "gradient": np.full(4, 400.0),
}


@pytest.mark.newest_jax  # which lines led to an operation is private to JAX
@pytest.mark.parametrize("name", PLANTED)
def test_the_line_that_loses_range_is_named(name):
    report = report_of(PLANTED[name], FIRST_FITS.get(name, BIG), 3, parties=2 + len(name) % 2)
    found = report.range_lost
    assert (found.place.file, found.place.line) == (__file__, line(f"range: {name}"))
    assert found.magnitude > 1
    assert report.first == found
    assert f"{found.place.short} " in str(report)
    assert f"{__file__}:{found.place.line} " in report.summary()


@pytest.mark.filterwarnings("ignore:cannot share")
def test_an_argument_that_holds_no_number_is_named():
    step = cn.secure(lambda w, x: x["b"] + w)

    @jax.jit
    def run(values):
        args = cn.share(jax.random.key(0), (np.ones(2), {"b": values}), parties=3)
        return cn.validate(step)(KEY, *args)[1]

    report = run(np.array([1.0, np.nan]))
    assert report.first.place.function == "args[1]['b']"
    assert (report.first.lost, report.first.not_numbers) == ("range", 1)
    assert report.rows[-1].not_numbers == 1  # it has spread


def test_an_argument_of_which_a_step_made_no_number_is_named():
    step = cn.secure(lambda w, x: x["b"] + w)
    divide = cn.secure(lambda b, n: b / n)  # under jit nobody can look at the divisor

    @jax.jit
    def run(n):
        w, b = cn.share(jax.random.key(0), (np.ones(2), np.ones(2)), parties=3)
        return cn.validate(step)(KEY, w, {"b": divide(jax.random.key(1), b, n)})[1]

    report = run(np.float64(0.0))
    assert report.first.place.function == "args[1]['b']"
    assert (report.first.lost, report.first.not_numbers) == ("range", 2)
    assert report.rows[-1].not_numbers == 2  # it has spread


# --- lines that lose resolution -------------------------------------------------------------------------


def average(w, x, y):
    error = x @ w - y
    return jnp.mean(error * error)  # resolution: mean


def summed(w, x, y):
    error = x @ w - y
    return jnp.sum(error * error)


RNG = np.random.default_rng(0)
# Small errors of many samples: what the gradient of their mean starts from is of size 5e-7, of the sum 2e-3.
SAMPLES = (RNG.normal(size=(8, 1)), RNG.normal(size=(4096, 8)))
SAMPLES = (*SAMPLES, SAMPLES[1] @ SAMPLES[0] + 1e-3 * RNG.normal(size=(4096, 1)))


def test_the_gradient_of_a_mean_is_lost_and_that_of_a_sum_is_not():
    report = report_of(jax.grad(average), *SAMPLES, parties=3)
    found = report.resolution_lost
    assert (found.place.file, found.place.line) == (__file__, line("resolution: mean"))
    assert found.faint > 0.9 * found.values
    assert report.range_lost is None
    report = report_of(jax.grad(summed), *SAMPLES, parties=3)
    assert report.first is None
    assert "Neither range nor resolution is lost." in str(report)


def test_a_learning_rate_below_the_resolution_is_named():
    def update(w, rate):
        return w - rate * w  # resolution: rate

    report = report_of(update, np.linspace(0.5, 2.0, 8), np.float64(1e-7))
    assert report.first.place.line == line("resolution: rate")
    assert (report.first.lost, report.first.faint) == ("resolution", 8)
    assert report_of(update, np.linspace(0.5, 2.0, 8), np.float64(1e-2)).first is None


def test_a_few_small_entries_among_large_ones_are_no_loss():
    x = np.concatenate([np.full(4, 2.0), np.full(60, 2.0**-12)])
    report = report_of(lambda x: x * x, x)
    assert report.first is None
    (row,) = [row for row in report.rows if row.primitive == "mul"]
    assert (row.faint, row.values) == (60, 64)


# --- what else goes wrong -------------------------------------------------------------------------------


@pytest.mark.parametrize(("truncation", "parties"), [("wrap-count", 3), ("local", 2)])
def test_truncations_that_fail_are_named_in_a_loop(truncation, parties):
    def products(x, y):
        return lax.map(lambda xy: xy[0] * xy[1], (x, y))  # failed

    x = np.full((4, 1 << 13), 3_000_000.0)
    protocol = cn.Protocol(truncation=truncation)
    args = shared((x, np.ones_like(x)), parties, truncation=truncation)
    result, report = cn.validate(cn.secure(products, protocol=protocol))(KEY, *args)
    assert report.first.place.line == line("failed")
    assert report.first.truncations == x.size
    assert report.first.failed == np.sum(np.abs(cn.reveal(result) - x) > 1) > 0


def test_comparisons_beyond_range_bits_are_named():
    def largest(x, y):
        return jnp.maximum(x, y)  # wrong

    x, y = np.array([1.0, 50.0, 2.0]), np.array([3.0, -46.0, 1.0])
    report = report_of(largest, x, y, range_bits=5)
    assert report.first.place.line == line("wrong")
    assert (report.first.lost, report.first.wrong) == ("range", 1)
    assert report_of(largest, x, y, range_bits=8).first is None


def test_masks_are_no_loss():
    def masked(x, mask):
        y = x + mask
        return jnp.max(y), jnp.argmax(x * x + mask), jnp.where(y > 2, y, -jnp.inf), jnp.maximum(y, -3e38)

    for mask in (-1e9, -np.inf, np.finfo(np.float64).min):
        report = report_of(masked, np.array([1.0, 2.0, 3.0]), jnp.array([0.0, 0.0, mask]))
        assert report.first is None


def test_a_public_number_that_is_not_usable_raises_as_the_step_does():
    with pytest.raises(ValueError, match=r"test_validation\.py"):
        report_of(lambda x, n: x / n, BIG, jnp.float64(0))


# --- the numbers ----------------------------------------------------------------------------------------


def test_magnitudes_errors_and_counts_are_those_of_the_values():
    x = RNG.uniform(-8, 8, 1000)
    ours = shared(x, parties=3)

    def steps(x):
        y = x * x
        return y, y * 0.3, y > 1.0

    (y, _, bits), report = cn.validate(cn.secure(steps))(KEY, ours)
    rows = {row.primitive: row for row in report.equations[:2]} | {"gt": report.equations[-1]}
    encoded = np.round(x * 2**20) / 2**20
    assert rows["argument"].magnitude == pytest.approx(np.max(np.abs(encoded)) / 2**22)
    assert rows["mul"].magnitude == pytest.approx(np.max(encoded**2) / 2**22)
    assert (rows["mul"].values, rows["mul"].truncations, rows["mul"].error) == (1000, 1000, 0.0)
    scaled = report.equations[2]
    assert 0 < scaled.error < 64 * 0.3  # the constant is 0.3 within 2^-20 of itself
    assert scaled.truncations == 1000
    assert rows["gt"].differing == np.sum(cn.reveal(bits) != (encoded**2 > 1.0))
    assert np.max(np.abs(cn.reveal(y) - encoded**2)) < 2**-20


def test_every_rule_has_a_reference():
    arguments = {
        name: RNG.uniform(-2, 2, shape) if dtype == jnp.float64 else RNG.uniform(size=shape) < 0.5
        for name, (shape, dtype) in primitives.SHAPES.items()
    } | {"w": jnp.asarray(RNG.uniform(0.5, 2, 64)), "n": jnp.asarray(3)}

    def all_examples(*args):
        return [example.function(*args) for example in primitives.examples()]

    ideal = dict.fromkeys(("multiplication", "truncation", "comparison"), "ideal")  # small programs
    report = report_of(all_examples, *[arguments[name] for name in primitives.NAMES], **ideal)
    assert report.first is None
    assert max(row.error for row in report.rows) < 8
    assert {row.primitive for row in report.rows if row.differing} <= {"argmax", "argmin"}
    told = {row.primitive for row in report.rows}
    untold = {example.primitive for example in primitives.examples()} - told
    assert untold == {"scan", "while", "cond", "is_finite"}  # their bodies are; the last is public


# --- where it stands ------------------------------------------------------------------------------------


def looped(x, n):
    def body(x, factor):
        x = lax.cond(n > 2, lambda x: jax.nn.relu(x * x) * factor, lambda x: x, x)
        return x, x > 0.1

    return lax.scan(body, x, jnp.array([0.5, 0.25]))


@pytest.mark.parametrize("parties", [2, 3])
def test_the_result_is_that_of_the_step_bit_for_bit(parties):
    args = shared(RNG.normal(size=8), parties), 3
    step = cn.secure(looped)
    result, _ = cn.validate(step)(KEY, *args)
    for ours, steps in zip(jax.tree.leaves(result), jax.tree.leaves(step(KEY, *args)), strict=True):
        np.testing.assert_array_equal(ours, steps)


def test_the_papers_classifier_loses_nothing():
    work = works()["forward"]
    args = shared(work.args)
    result, report = cn.validate(cn.secure(work.function))(KEY, *args)
    assert report.first is None
    error = np.max(np.abs(cn.reveal(result) - work.function(*cn.reveal(args)))) * 2**20
    assert abs(report.equations[-1].error - error) < 1  # it is truncated once more


def test_strict_raises_and_names_the_line():
    with pytest.raises(
        cn.ValidationError, match=rf"test_validation.py:{line('range: straight')} .*214 %"
    ) as raised:
        report_of(straight, BIG, 3, strict=True)
    assert raised.value.report.first.primitive == "mul"
    assert report_of(straight, BIG / 10, 3, strict=True).first is None


def test_it_works_in_a_training_loop_and_reports_on_all_steps():
    step = cn.validate(cn.secure(lambda x: x * x))
    _, reports = lax.scan(lambda x, key: step(key, x), shared(np.full(2, 2.0)), jax.random.split(KEY, 5))
    (row,) = [row for row in reports.rows if row.primitive == "mul"]
    assert (row.values, row.truncations) == (10, 10)
    assert row.magnitude == pytest.approx(2.0**32 / 2**22)  # 2, 4, 16, 256, 65,536 and no further
    assert reports.first == row
    with pytest.raises(cn.ValidationError, match="of what fits"):
        reports.check()


def test_reports_of_a_loop_in_python_are_merged():
    step = cn.validate(cn.secure(lambda x: x * x))
    (_, small), (_, large) = (step(KEY, shared(np.full(2, v))) for v in (2.0, 1000.0))
    merged = small.merged(large)
    assert [row.values for row in merged.rows] == [4, 4]
    assert merged.rows[1].magnitude == large.rows[1].magnitude > small.rows[1].magnitude


def test_under_jit_the_report_is_looked_at_outside():
    step = cn.validate(cn.secure(lambda x: x * x), strict=True)
    with pytest.raises(TypeError, match="look at it outside"):
        jax.jit(step)(KEY, shared(np.ones(2)))


def test_a_report_is_made_of_numbers_and_strings():
    report = report_of(straight, BIG, 3)
    told = json.loads(json.dumps(report.as_dict()))
    assert told["range_lost"]["place"]["line"] == line("range: straight")
    assert told["resolution_lost"] is None
    assert [row["primitive"] for row in told["rows"]] == ["argument", "sub", "mul", "mul"]


def test_only_a_secure_function_is_validated():
    with pytest.raises(TypeError, match="secure"):
        cn.validate(straight)
