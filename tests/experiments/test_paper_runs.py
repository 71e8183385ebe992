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

    monkeypatch.setattr(runs, "train", None)  # not asked for again
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
    assert (recipe.momentum, recipe.schedule, recipe.standardised) == (0, "constant", False)
    assert recipe.scale * recipe.batch * 5 == pytest.approx(0.01, rel=0.1)
