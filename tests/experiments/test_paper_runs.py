"""A row of the paper's tables, end to end on a small world without a renderer."""

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest

from ciphernav_jax import files
from ciphernav_jax.navigation import metrics
from ciphernav_jax.navigation.classifier import FreshClassifier
from ciphernav_jax.navigation.plain import EndToEnd
from ciphernav_jax.navigation.rollout import random_walk
from ciphernav_jax.navigation.sight import Looking
from experiments.paper import accuracy, beyond, fewest_steps, paper_recipe, runs
from experiments.paper.runs import Options, Row
from experiments.report import table
from tests.navigation.conftest import make

TEACHER = Row("plaintext", "plaintext", EndToEnd(epochs=1, batch=60))
SECRET = Row("secret-3", "secret", FreshClassifier(steps=4, batch=16, chunk=2), 3)

ROWS = (*accuracy.ROWS, *fewest_steps.ROWS, *paper_recipe.ROWS, *beyond.ROWS)


@pytest.fixture
def small(monkeypatch, tmp_path):
    environments = {name: make(40, seed) for seed, name in enumerate(("train", "test", "unseen"))}
    monkeypatch.setattr(runs, "world", lambda name, out: environments[name])
    return Options(seeds=[0], out=tmp_path / "out", results=tmp_path / "results")


@pytest.mark.slow
def test_a_secret_row_is_written_whole_and_only_once(small, monkeypatch):
    document = runs.run_row(SECRET, 0, {"plaintext": TEACHER}, small)
    path = small.results / "secret-3-0.json"
    assert files.read_json(path) == document
    assert [point["step"] for point in document["curve"]] == [2, 4]
    assert document["seconds"]["train"] > 0 < document["seconds"]["compile"]
    assert all(point["failed"] == 0 < point["truncations"] for point in document["curve"])
    assert document["cost"]["training step"]["parties"] == 3
    assert document["cost"]["decision"]["rounds"] > 0
    made = np.sum(np.asarray(runs.world("train", small.out).actions) >= 0)
    assert document["epochs"] == round(4 * 16 / made, 3)
    assert list(document["held"]) == ["robot", "camera owner", "helper 1"]
    for name in runs.TEST_SETS:
        assert metrics.overall(document["results"][name]["counts"])["trials"] == 40

    monkeypatch.setattr(runs, "train_row", None)  # not asked for again
    assert runs.run_row(SECRET, 0, {}, small) == document
    other = dataclasses.replace(SECRET, recipe=FreshClassifier(steps=6, batch=16, chunk=2))
    with pytest.raises(ValueError, match="another configuration"):
        runs.run_row(other, 0, {}, small)


def test_careful_robots_share_a_training_and_have_eyes_of_their_own(small):
    eyes = Looking(steps=4, batch=20, chunk=2)
    known = {row.name: row for row in (TEACHER, SECRET)}
    row = Row("beyond-3", "secret", parties=3, drives="secret-3", eyes=eyes)
    document = runs.run_row(row, 0, known, small)
    assert sorted(path.name for path in (small.out / "models").iterdir()) == [
        "plaintext-0",
        "secret-3-0",
        "sight-0",
    ]
    assert [point["step"] for point in document["curve"]] == [2, 4]
    assert not {"cost", "epochs"} & set(document)  # the training's are in its own row

    alone = runs.run_row(Row("alone", "alone", eyes=eyes), 0, {}, small)
    for name in runs.TEST_SETS:
        assert 0 <= document["results"][name]["alone"] <= 40
        assert alone["results"][name]["alone"] == 40


def test_the_lengths_add_up_to_all():
    world = make(60, 3)
    episodes = random_walk(world, 0)
    lengths = runs.by_length(world, episodes)
    whole = metrics.tally(world, episodes)
    for half in ("detour", "no_detour"):
        for kind, count in whole[half].items():
            assert sum(counts[half][kind] for counts in lengths.values()) == count
    assert sorted(map(int, lengths)) == np.unique((world.actions > 0).sum(axis=1)).tolist()


def test_names_are_unique_and_a_wrong_one_is_answered_with_those_there_are(monkeypatch, capsys):
    assert len({row.name for row in ROWS}) == len(ROWS)
    monkeypatch.setattr("sys.argv", ["accuracy", "--rows", "secret-7"])
    with pytest.raises(ValueError, match="the rows are random, map-only"):
        runs.script(accuracy.__doc__, accuracy.ROWS, runs.RowOptions())


def told(monkeypatch, capsys, *words):
    """What a script of the random walk prints."""
    monkeypatch.setattr("sys.argv", ["accuracy", *words])
    runs.script(accuracy.__doc__, accuracy.ROWS, runs.RowOptions(rows=["random"], seeds=[0]))
    return capsys.readouterr().out


def test_what_is_kept_is_said_with_its_file_its_date_and_the_way_to_run_it(
    small, tmp_path, monkeypatch, capsys
):
    words = ("--out", str(small.out), "--results", str(small.results))
    assert "kept" not in told(monkeypatch, capsys, *words)
    path = small.results / "random-0.json"
    document = json.loads(path.read_text())
    again = told(monkeypatch, capsys, *words)
    assert f"random, seed 0: kept, not run; {path}, made {document['at']} with ciphernav_jax" in again
    assert f"1 of 1 runs were kept from {small.results}, and not run now." in again
    assert f"--results {small.out}/results" in again
    one_more = told(monkeypatch, capsys, *words, "--seeds", "0", "1")
    assert one_more.count("kept, not run") == 1
    assert "1 of 2 runs were kept" in one_more


def test_the_small_size_stays_apart(small, tmp_path, monkeypatch, capsys):
    shown = told(monkeypatch, capsys, "--out", str(small.out), "--small")
    assert "not the paper's task" in " ".join(shown.split())
    path = small.out / "small" / "results" / "random-0.json"
    configuration = json.loads(path.read_text())["configuration"]
    assert (configuration["train"], configuration["test"]) == (200, 100)
    with pytest.raises(ValueError, match="another configuration"):
        runs.run_row(accuracy.ROWS[0], 0, {}, Options(out=small.out, results=path.parent))
    with pytest.raises(ValueError, match="leave --results out"):
        told(monkeypatch, capsys, "--small", "--results", str(small.results))


def test_the_small_size_has_the_same_rows_with_fewer_steps():
    for row in ROWS:
        short = runs.shortened(row)
        if isinstance(row.recipe, FreshClassifier):
            assert isinstance(short.recipe, FreshClassifier)
            assert short.recipe.steps == row.recipe.steps // 10 > 0
        assert (short.name, short.method, short.parties) == (row.name, row.method, row.parties)


def test_an_unseen_set_asks_for_no_view_of_the_training_set(monkeypatch, tmp_path):
    asked = {}
    monkeypatch.setattr(
        runs.dataset, "generate", lambda split, *_, unseen_by=None: asked.setdefault(split, unseen_by)
    )
    options = runs.RowOptions(out=tmp_path, small=True)
    runs.world("unseen", options)
    assert list(asked) == ["test"]
    assert asked["test"] == runs.training(200)
    assert len(asked["test"].pairs()) > 100


def test_the_report_asks_for_rows_that_the_scripts_make():
    assert {*table.ROWS, *table.BEYOND, *table.CHEAP} <= {row.name for row in ROWS}
    assert table.ONE_SEED == accuracy.ONE_SEED


def test_the_committed_results_are_of_the_rows_as_they_are():
    rows = {row.name: row for row in ROWS}
    found = 0
    for path in (Path(__file__).parents[2] / "experiments" / "results" / "paper").glob("*.json"):
        document = json.loads(path.read_text())
        if "curve" in document:
            assert document["configuration"] == runs.configured(rows[document["row"]]), path
            found += 1
    assert found > 40


def test_the_papers_recipe_keeps_its_rate_and_standardises_nothing():
    recipe = paper_recipe.ROWS[0].recipe
    assert isinstance(recipe, FreshClassifier)
    assert (recipe.momentum, recipe.schedule, recipe.standardised) == (0, "constant", False)
    assert recipe.scale(5) * recipe.batch * 5 == pytest.approx(0.01, rel=0.1)
