"""Training folders: resume to the same bits, and refuse what is not theirs."""

import dataclasses
import shutil
from pathlib import Path

import jax
import numpy as np
import pytest

import ciphernav_jax as cn
from ciphernav_jax import files
from ciphernav_jax.files import BusyError, DamagedError
from ciphernav_jax.navigation import driving, features, folders, trainings
from ciphernav_jax.navigation.classifier import FreshClassifier
from ciphernav_jax.navigation.methods import METHODS
from ciphernav_jax.navigation.plain import EndToEnd
from ciphernav_jax.navigation.policies import plain_policy, secret_policy
from ciphernav_jax.world.poses import LANES
from tests.navigation.conftest import Killed, assert_same, killed_after_first, silent, untimed

pytestmark = pytest.mark.slow

PLAIN = EndToEnd(epochs=3, batch=30)
FRESH = FreshClassifier(steps=6, batch=32, chunk=2)


@pytest.fixture(scope="module")
def teacher(world, tmp_path_factory):
    folder = tmp_path_factory.mktemp("teacher")
    trainings.train_end_to_end(world, "plaintext", EndToEnd(epochs=1, batch=60), 0, folder, silent)
    return folders.load(folder)[1]


def test_end_to_end_training_resumes_to_the_same_bits(world, tmp_path):
    whole = trainings.train_end_to_end(world, "map-only", PLAIN, 0, tmp_path / "whole", silent)
    with pytest.raises(Killed):
        trainings.train_end_to_end(world, "map-only", PLAIN, 0, tmp_path / "killed", killed_after_first)
    with pytest.raises(DamagedError, match="not finished"):
        folders.load(tmp_path / "killed")
    resumed = trainings.train_end_to_end(world, "map-only", PLAIN, 0, tmp_path / "killed", silent)
    assert_same(resumed, whole)
    assert untimed(folders.curve(tmp_path / "killed")) == untimed(folders.curve(tmp_path / "whole"))
    assert_same(folders.load(tmp_path / "whole")[1], whole)


@pytest.mark.parametrize("parties", [None, 2])
def test_classifier_training_resumes_to_the_same_bits(world, teacher, tmp_path, parties):
    def train(folder, report):
        return trainings.train_classifier(world, teacher, FRESH, 0, tmp_path / folder, report, parties)

    whole = train("whole", silent)
    with pytest.raises(Killed):
        train("killed", killed_after_first)
    resumed = train("killed", silent)
    assert_same(resumed, whole)  # of secrets, the shares
    config, loaded = folders.load(tmp_path / "killed")
    assert_same(loaded, whole)
    assert config["parties"] == parties
    curve = folders.curve(tmp_path / "killed")
    assert untimed(curve) == untimed(folders.curve(tmp_path / "whole"))
    assert [point["step"] for point in curve] == [2, 4, 6]
    assert ["compile_seconds" in point for point in curve] == [True, True, False]  # killed after the first
    if parties:
        assert all(point["truncations"] > 0 == point["failed"] for point in curve)


def test_secret_training_and_driving_follow_plaintext(world, teacher, tmp_path):
    plain = trainings.train_classifier(world, teacher, FRESH, 0, tmp_path / "plain", silent)
    secret = trainings.train_classifier(world, teacher, FRESH, 0, tmp_path / "secret", silent, 2)
    for weights, shared in zip(
        jax.tree.leaves(plain.weights), jax.tree.leaves(cn.reveal(secret.weights)), strict=True
    ):
        np.testing.assert_allclose(shared, weights, atol=1e-3)
    first, second = (
        [point["loss"] for point in folders.curve(tmp_path / name)] for name in ("plain", "secret")
    )
    np.testing.assert_allclose(first, second, rtol=1e-2)
    first, second = (
        [point["accuracy"] for point in folders.curve(tmp_path / name)] for name in ("plain", "secret")
    )
    np.testing.assert_allclose(first, second, atol=100 / FRESH.batch)  # at most one answer differs

    few = dataclasses.replace(
        world, **{name: getattr(world, name)[:16] for name in ("cameras", "agent", "layout", "goal")}
    )
    method = folders.sees({"method": "secret"})
    seen = features.standardise(secret.encode(few, method), secret.scales)
    start, heading = np.zeros(16, int), np.full(16, 3)
    opened = plain_policy(cn.reveal(secret.weights), seen)(0, start, heading)
    chosen = secret_policy(secret.weights, seen, jax.random.key(1), 2)(0, start, heading)
    np.testing.assert_array_equal(chosen, opened)
    public = secret_policy(cn.reveal(secret.weights), seen, jax.random.key(1), 3)(0, start, heading)
    np.testing.assert_array_equal(public, opened)
    logits = cn.Protocol(opened="logits")
    shown = secret_policy(secret.weights, seen, jax.random.key(1), 2, logits)(0, start, heading)
    np.testing.assert_array_equal(shown, opened)


def test_a_finished_training_is_not_done_twice(world, tmp_path):
    first = trainings.train_end_to_end(world, "map-only", PLAIN, 0, tmp_path, silent)
    assert_same(trainings.train_end_to_end(world, "map-only", PLAIN, 0, tmp_path, killed_after_first), first)


def test_a_folder_goes_on_only_with_the_same_training(world, tmp_path):
    with pytest.raises(Killed):
        trainings.train_end_to_end(world, "map-only", PLAIN, 0, tmp_path, killed_after_first)
    with pytest.raises(DamagedError, match="differs in seed"):
        trainings.train_end_to_end(world, "map-only", PLAIN, 1, tmp_path, silent)
    with pytest.raises(DamagedError, match="differs in method"):
        trainings.train_end_to_end(world, "first-person", PLAIN, 0, tmp_path, silent)


def test_a_classifier_goes_on_only_with_the_same_encoders(world, teacher, tmp_path):
    with pytest.raises(Killed):
        trainings.train_classifier(world, teacher, FRESH, 0, tmp_path, killed_after_first)
    other = teacher._replace(encoders=jax.tree.map(lambda leaf: leaf + np.float32(1), teacher.encoders))
    with pytest.raises(DamagedError, match="differs in encoders"):
        trainings.train_classifier(world, other, FRESH, 0, tmp_path, silent)


def test_a_damaged_checkpoint_is_named(world, tmp_path):
    with pytest.raises(Killed):
        trainings.train_end_to_end(world, "map-only", PLAIN, 0, tmp_path, killed_after_first)
    flip_a_bit(tmp_path / "checkpoint.npz")
    with pytest.raises(DamagedError, match=rf"checkpoint\.npz is not what.*; remove {tmp_path} and"):
        trainings.train_end_to_end(world, "map-only", PLAIN, 0, tmp_path, silent)


def flip_a_bit(path):
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(content)


@pytest.fixture(scope="module")
def finished(world, tmp_path_factory):
    folder = tmp_path_factory.mktemp("finished")
    trainings.train_end_to_end(world, "map-only", PLAIN, 0, folder, silent)
    return folder


@pytest.mark.parametrize("harm", [flip_a_bit, Path.unlink])
@pytest.mark.parametrize("name", ["config.json", "curve.json", "model.npz"])
def test_what_a_finished_training_lacks_is_named_and_never_replaced(finished, tmp_path, name, harm):
    folder = tmp_path / "harmed"
    shutil.copytree(finished, folder)
    harm(folder / name)
    with pytest.raises(DamagedError, match=rf"{name}|not finished") as raised:
        _ = folders.load(folder), folders.curve(folder)
    assert str(folder) in str(raised.value)


def test_the_weights_of_another_training_do_not_pass_for_its_own(world, finished, tmp_path):
    trainings.train_end_to_end(world, "map-only", PLAIN, 1, tmp_path, silent)
    shutil.copy(finished / "model.npz", tmp_path)
    with pytest.raises(DamagedError, match=r"model\.npz is not what"):
        folders.load(tmp_path)


def test_a_training_that_lost_its_curve_goes_on_to_the_same_bits(world, finished, tmp_path):
    folder = tmp_path / "harmed"
    shutil.copytree(finished, folder)
    (folder / "curve.json").unlink()
    trainings.train_end_to_end(world, "map-only", PLAIN, 0, folder, silent)
    for name in ("model.npz", "curve.json", "config.json"):
        assert (folder / name).read_bytes() == (finished / name).read_bytes()


def test_two_trainings_in_one_folder_are_refused(world, tmp_path):
    with files.claimed(tmp_path), pytest.raises(BusyError, match=f"another process is writing to {tmp_path}"):
        trainings.train_end_to_end(world, "map-only", PLAIN, 0, tmp_path, silent)


def test_a_batch_of_more_than_all_samples_is_refused(world, teacher, tmp_path):
    large = FreshClassifier(steps=2, batch=10**9)
    with pytest.raises(ValueError, match=r"a batch of 1,000,000,000 is more than the \d+ samples"):
        trainings.train_classifier(world, teacher, large, 0, tmp_path / "none", silent)
    assert not (tmp_path / "none").exists()


def test_a_folder_that_is_no_training_is_refused(tmp_path):
    with pytest.raises(DamagedError, match=r"config\.json is missing"):
        folders.load(tmp_path)
    (tmp_path / "config.json").write_text("{")
    with pytest.raises(DamagedError, match="damaged"):
        folders.load(tmp_path)
    files.write_json(tmp_path / "config.json", {})
    with pytest.raises(DamagedError, match="holds no training"):
        folders.load(tmp_path)


def test_fewer_than_two_parties_are_refused_before_anything_is_written(world, teacher, tmp_path):
    with pytest.raises(ValueError, match="at least two parties"):
        trainings.train_classifier(world, teacher, FRESH, 0, tmp_path / "one", silent, 1)
    assert not (tmp_path / "one").exists()


def test_the_loss_of_lanes_teaches_the_encoder_what_is_in_them(world, tmp_path):
    """On views that show their lane, a linear probe with small weights finds more of the obstacles."""

    def left_over(name, lanes):
        recipe = EndToEnd(epochs=8, batch=30, lanes=lanes)
        model = trainings.train_end_to_end(world, "plaintext", recipe, 0, tmp_path / name, silent)
        seen = np.concatenate(model.encode(world, METHODS["plaintext"]).cameras)
        known = np.column_stack([seen, np.ones(len(seen))])
        ahead = np.concatenate([world.obstacles[:, lane[1:]] for lane in LANES]).astype(float)
        small = np.linalg.solve(known.T @ known + 100 * np.eye(known.shape[1]), known.T @ ahead)
        best = np.linalg.lstsq(known, ahead)[0]
        return np.square(known @ small - ahead).sum() - np.square(known @ best - ahead).sum()

    assert left_over("with", 5.0) < 0.7 * left_over("without", 0.0)


def test_smoothed_labels_bound_the_loss_from_below(world, tmp_path):
    def losses(smoothing):
        recipe = EndToEnd(epochs=3, batch=30, smoothing=smoothing)
        folder = tmp_path / str(smoothing)
        trainings.train_end_to_end(world, "map-only", recipe, 0, folder, silent)
        return [point["loss"] for point in folders.curve(folder)]

    label = np.array([0.1 + 0.9 / 5] + [0.9 / 5] * 4)  # its entropy, 1.591, is the least loss there is
    entropy = -np.sum(label * np.log(label))
    assert min(losses(0.9)) >= entropy
    assert min(losses(0.0)) < entropy


@pytest.mark.parametrize("smoothing", [1.0, -0.1])
def test_smoothing_out_of_range_is_refused(smoothing):
    with pytest.raises(ValueError, match=r"\[0, 1\)"):
        EndToEnd(smoothing=smoothing)


def test_the_squared_loss_is_not_smoothed():
    with pytest.raises(ValueError, match="squared loss"):
        EndToEnd(loss="squared", smoothing=0.1)


def test_a_variant_is_trained_and_driven_by(world, teacher, tmp_path):
    protocol = cn.Protocol(frac_bits=18, truncation="local", opened="logits")
    model = trainings.train_classifier(world, teacher, FRESH, 0, tmp_path, silent, 2, protocol)
    config, loaded = folders.load(tmp_path)
    assert cn.Protocol(**config["protocol"]) == protocol
    assert {weight.frac_bits for weight in jax.tree.leaves(loaded.weights, is_leaf=is_secret)} == {18}
    assert_same(loaded, model)
    driven = driving.drive(world, config, loaded, 0)
    np.testing.assert_array_equal(driven.actions >= 0, driven.cells[:, :-1] >= 0)
    with pytest.raises(ValueError, match="trained with"):
        driving.drive(world, config, loaded, 0, protocol=cn.Protocol())
    with pytest.raises(ValueError, match="say --parties"):
        driving.drive(world, {**config, "parties": None}, teacher, 0, protocol=protocol)
    with pytest.raises(DamagedError, match="differs in protocol"):
        trainings.train_classifier(world, teacher, FRESH, 0, tmp_path, silent, 2)


def is_secret(leaf):
    return isinstance(leaf, cn.Secret)
