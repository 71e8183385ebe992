"""A network on a table that is split vertically: the same in secret as in the clear, and gone on with."""

import warnings

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import ciphernav_jax as cn
from ciphernav_jax.files import DamagedError
from ciphernav_jax.learning import Checkpoint, Column, Model, Sgd, SplitTable, fit
from tests.navigation.conftest import Killed, assert_same, killed_after_first, untimed

RECIPE = Sgd(steps=6, batch=20, learning_rate=0.25, chunk=2)
KEY = jax.random.key(7)


def predict(weights, columns):
    hidden = jax.nn.relu(jnp.concatenate(columns, axis=1) @ weights["in"] + weights["bias"])
    return hidden @ weights["out"]


MODEL = Model(predict, outputs=2)


def start():
    rng = np.random.default_rng(1)
    shapes = {"in": (4, 8), "bias": (8,), "out": (8, 2)}
    return {name: 0.3 * rng.normal(size=shape).astype(np.float32) for name, shape in shapes.items()}


def patients(owners=("first", "second")):
    """Three columns of 50 patients, one of which is of the 5 wards that they lie in."""
    rng = np.random.default_rng(0)
    age, blood = (rng.normal(size=(50, width)).astype(np.float32) for width in (1, 2))
    wards, ward = rng.normal(size=(5, 1)).astype(np.float32), rng.integers(5, size=50)
    ill = (age + blood.sum(1, keepdims=True) + wards[ward] > 0)[:, 0]
    columns = {
        "age": Column(owners[0], age),
        "blood": Column(owners[1], blood),
        "ward": Column(owners[0], wards, rows=ward),
    }
    return SplitTable(columns, answers=Column(owners[1], np.eye(2, dtype=np.float32)[ill.astype(int)]))


@pytest.mark.parametrize("parties", [2, 3])
def test_in_secret_it_learns_what_it_learns_in_the_clear(parties):
    plain, open_curve = fit(MODEL, start(), patients(), RECIPE, KEY)
    secret, curve = fit(MODEL, start(), patients(), RECIPE, KEY, parties=parties)
    assert {weight.parties for weight in secret.values()} == {parties}
    for name, weight in plain.items():
        np.testing.assert_allclose(cn.reveal(secret[name]), weight, atol=1e-4)
    np.testing.assert_allclose(
        [point["loss"] for point in curve], [point["loss"] for point in open_curve], rtol=1e-4
    )
    assert [point["step"] for point in curve] == [2, 4, 6]
    assert curve[-1]["loss"] < curve[0]["loss"]
    assert all(point["truncations"] > 0 == point["failed"] for point in curve)


def test_a_step_is_that_of_gradient_descent_with_momentum():
    """By hand, in float64: two steps on all samples with a rate that falls in a straight line."""
    table = patients()
    recipe = Sgd(steps=2, batch=50, learning_rate=0.25, momentum=0.5, chunk=1)
    found, curve = fit(MODEL, start(), table, recipe, KEY)
    columns = tuple(
        np.asarray(c.values)[c.at(np.arange(50))].astype(np.float64) for c in table.columns.values()
    )
    answers = np.asarray(table.answers.values, np.float64)

    def loss(weights):
        return jnp.sum((predict(weights, columns) - answers) ** 2)

    weights = {name: jnp.asarray(value, np.float64) for name, value in start().items()}
    velocity = jax.tree.map(jnp.zeros_like, weights)
    for decay, point in zip((1.0, 0.5), curve, strict=True):
        assert point["loss"] == pytest.approx(float(loss(weights)) / 100, rel=1e-5)
        rate = 2.0**-9 * decay  # 0.25 / (50 * 2) is nearest to 2^-9 among the powers of two
        velocity = jax.tree.map(lambda v, g, rate=rate: 0.5 * v - rate * g, velocity, jax.grad(loss)(weights))
        weights = jax.tree.map(jnp.add, weights, velocity)
    for name, weight in weights.items():
        np.testing.assert_allclose(found[name], weight, atol=1e-5)


@pytest.mark.parametrize("parties", [None, 2])
def test_it_goes_on_from_a_checkpoint_to_the_same_bits(tmp_path, parties):
    def run(name, report=None):
        checkpoint = Checkpoint(tmp_path / name)
        return fit(
            MODEL, start(), patients(), RECIPE, KEY, parties=parties, checkpoint=checkpoint, report=report
        )

    whole, curve = run("whole")
    with pytest.raises(Killed):
        run("killed", killed_after_first)
    resumed, later = run("killed")
    assert untimed(later) == untimed(curve)
    assert_same(resumed, whole)  # of secrets, the shares
    if parties is not None:
        with pytest.raises(DamagedError, match="is not what was written"):
            fit(MODEL, start(), patients(), RECIPE, KEY, checkpoint=Checkpoint(tmp_path / "whole", "other"))


def test_the_weights_to_start_with_are_kept():
    begin = jax.tree.map(jnp.asarray, start())
    fit(MODEL, begin, patients(), RECIPE, KEY)
    for name, weight in start().items():
        np.testing.assert_array_equal(begin[name], weight)


def test_in_float64_too():
    wide = jax.tree.map(lambda x: x.astype(np.float64), start())
    table = patients()
    columns = {
        name: Column(of.owner, np.asarray(of.values, np.float64), of.rows)
        for name, of in table.columns.items()
    }
    answers = Column("second", np.asarray(table.answers.values, np.float64))
    secret, curve = fit(MODEL, wide, SplitTable(columns, answers), RECIPE, KEY, parties=2)
    plain, open_curve = fit(MODEL, wide, SplitTable(columns, answers), RECIPE, KEY)
    assert {weight.dtype for weight in (*secret.values(), *plain.values())} == {np.dtype(np.float64)}
    assert curve[-1]["loss"] == pytest.approx(open_curve[-1]["loss"], rel=1e-4)


def test_more_owners_than_parties_are_refused():
    columns = dict(patients().columns)
    columns["age"] = Column("third", columns["age"].values)
    table = SplitTable(columns, answers=patients().answers)
    assert table.owners == ("third", "second", "first")
    with pytest.raises(ValueError, match="third, second, first hold columns, but there are 2 parties"):
        fit(MODEL, start(), table, RECIPE, KEY, parties=2)


def test_columns_of_other_samples_are_refused():
    answers = Column("one", np.zeros((5, 2)))
    with pytest.raises(ValueError, match="column 'age' has 4 samples, the answers 5"):
        SplitTable({"age": Column("one", np.zeros((4, 1)))}, answers=answers)
    with pytest.raises(ValueError, match="column 'age' has 6 samples, the answers 5"):
        SplitTable({"age": Column("one", np.zeros((4, 1)), rows=np.zeros(6, int))}, answers=answers)
    with pytest.raises(ValueError, match="named 'labels'"):
        SplitTable({"labels": Column("one", np.zeros((5, 1)))}, answers=answers)


def test_a_batch_of_more_than_all_samples_is_refused():
    with pytest.raises(ValueError, match="a batch of 51 is more than the 50 samples"):
        fit(MODEL, start(), patients(), Sgd(batch=51), KEY)


def test_each_epoch_has_every_sample_once():
    steps, decay, (rows, answers) = patients().batches(Sgd(steps=10, batch=10), seed=3, steps=np.arange(10))
    assert steps.tolist() == list(range(10))
    np.testing.assert_allclose(decay, 1 - np.arange(10) / 10, rtol=1e-6)
    for epoch in (answers[:5], answers[5:]):
        assert sorted(epoch.ravel().tolist()) == list(range(50))
    assert (answers[:5] != answers[5:]).any()
    np.testing.assert_array_equal(rows[0], answers)
    assert rows[2].max() < 5


def test_the_key_of_another_training_is_warned_of():
    key = jax.random.key(8)
    recipe = Sgd(steps=1, batch=20, chunk=1)

    def train(**changed):
        given = {"recipe": recipe, "seed": 0} | changed
        fit(MODEL, start(), patients(), given["recipe"], key, seed=given["seed"], parties=2)

    with warnings.catch_warnings():
        warnings.simplefilter("error")
        train()
        train()  # the same again
    for changed in ({"seed": 1}, {"recipe": Sgd(steps=1, batch=20, chunk=1, momentum=0.5)}):
        with pytest.warns(cn.KeyReuseWarning, match="given to fit a second time"):
            train(**changed)
        train()


def test_another_trainings_checkpoint_is_refused(tmp_path):
    given = {
        "weights": start(),
        "table": patients(),
        "recipe": Sgd(steps=2, batch=20, chunk=1),
        "key": KEY,
        "seed": 0,
        "parties": None,
    }

    def train(**changed):
        return fit(MODEL, **(given | changed), checkpoint=Checkpoint(tmp_path / "latest"))

    whole, _ = train()
    columns = dict(patients().columns)
    columns["age"] = Column("first", -np.asarray(columns["age"].values))
    others = {
        "weights": {name: 2 * x for name, x in start().items()},
        "table": SplitTable(columns, answers=patients().answers),
        "recipe": Sgd(steps=1, batch=20, chunk=1),
        "key": jax.random.key(9),
        "seed": 1,
        "parties": 2,
    }
    for name, other in others.items():
        with pytest.raises(DamagedError, match="if it is another training's"):
            train(**{name: other})
    assert_same(train()[0], whole)
    with pytest.raises(DamagedError, match="if it is another training's"):
        train(parties=2, protocol=cn.Protocol(frac_bits=16))


@pytest.mark.parametrize("parties", [None, 2])
def test_outputs_that_answers_would_be_broadcast_to_are_refused(parties):
    table = patients()
    flat = SplitTable(table.columns, answers=Column("second", np.zeros(50, np.float32)))
    with pytest.raises(ValueError, match=r"an answer is float\[20\] for a batch of 20, and not \[20, 2\]"):
        fit(MODEL, start(), flat, RECIPE, KEY, parties=parties)
    with pytest.raises(ValueError, match=r"predict gives float\[20, 2\] .* not \[20, 5\]"):
        fit(Model(predict, 5), start(), table, RECIPE, KEY, parties=parties)


@pytest.mark.parametrize("parties", [None, 2])
def test_of_a_single_output_there_is_a_loss_and_no_accuracy(parties):
    one = Model(lambda weights, columns: predict(weights, columns)[:, :1], outputs=1)
    answers = Column("second", np.linspace(-1, 1, 50, dtype=np.float32)[:, None])
    table = SplitTable(patients().columns, answers)
    _, curve = fit(one, start(), table, Sgd(steps=2, batch=50, chunk=1), KEY, parties=parties)
    assert all("loss" in point and "accuracy" not in point for point in curve)


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"rows": np.arange(3, 8)}, r"rows lie in 0\.\.4, those of the values; these in 3\.\.7"),
        ({"rows": np.arange(-1, 4)}, r"rows lie in 0\.\.4"),
        ({"rows": np.ones(5, bool)}, r"int\[samples\], not bool"),
        ({"rows": np.zeros((5, 1), int)}, r"int\[samples\], not int64\[5, 1\]"),
        ({"values": np.float64(1)}, "a row for each sample"),
    ],
)
def test_columns_that_make_no_sense_are_refused(changed, message):
    with pytest.raises(ValueError, match=message):
        Column(**({"owner": "one", "values": np.zeros((5, 1))} | changed))


def test_a_column_is_no_secret_and_has_a_name_for_an_owner():
    shared = cn.share(KEY, np.zeros((5, 1)), parties=2)
    with pytest.raises(TypeError, match="in the clear"):
        Column("one", shared)
    with pytest.raises(TypeError, match="not by None"):
        Column(None, np.zeros((5, 1)))
    assert len(Column("one", [[1.0], [2.0]])) == 2


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("steps", -1),
        ("batch", 0),
        ("batch", 4.0),
        ("chunk", 0),
        ("learning_rate", 0.0),
        ("learning_rate", float("nan")),
        ("momentum", float("nan")),
        ("momentum", 1.0),
        ("schedule", "cosine"),
    ],
)
def test_recipes_out_of_range_are_refused(name, value):
    with pytest.raises(ValueError, match=f"^{name} .*{value}"):
        Sgd(**{name: value})


def test_no_key_is_refused():
    with pytest.raises(TypeError, match=r"jax\.random\.key\(seed\), and not a int"):
        fit(MODEL, start(), patients(), RECIPE, 5, parties=2)
