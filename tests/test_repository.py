"""The files by which others find, cite and check this repository say what is so."""

import tomllib
from pathlib import Path

import pytest
import yaml

import ciphernav_jax

ROOT = Path(__file__).parents[1]
READ = [
    ".github/ISSUE_TEMPLATE/primitive-without-a-rule.yml",
    ".github/workflows/test.yml",
    ".pre-commit-config.yaml",
    "CITATION.cff",
]


def read(name):
    return yaml.safe_load((ROOT / name).read_text())


@pytest.mark.parametrize("name", READ)
def test_it_can_be_read(name):
    assert isinstance(read(name), dict)


def test_versions_and_licences_agree():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    cited = read("CITATION.cff")
    assert cited["version"] == project["version"] == ciphernav_jax.__version__
    assert (cited["license"], cited["title"]) == (project["license"], project["name"])


def test_the_workflow_runs_what_a_change_must_pass_on_the_oldest_python():
    (job,) = read(".github/workflows/test.yml")["jobs"].values()
    assert ".ci/run" in [step.get("run") for step in job["steps"]]
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert project["requires-python"] == f">={job['strategy']['matrix']['python'][0]}"


def test_hooks_are_what_lint_runs():
    (repository,) = read(".pre-commit-config.yaml")["repos"]
    lint = (ROOT / "Makefile").read_text()
    assert all(hook["entry"] in lint for hook in repository["hooks"])


def test_every_field_of_the_form_has_a_label_of_its_own():
    fields = [field for field in read(READ[0])["body"] if field["type"] != "markdown"]
    labels = {field["attributes"]["label"] for field in fields}
    assert len(labels) == len(fields) == len({field["id"] for field in fields})
