"""The README's numbers come from committed JSON, and its code runs and prints what is shown."""

import contextlib
import io
import json
import re
from pathlib import Path

import jax
import numpy as np
import pytest

from ciphernav_jax.experiments import bench, sweep
from ciphernav_jax.experiments.report import results, write
from ciphernav_jax.navigation import metrics

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text()


def test_the_table_is_that_of_the_committed_results():
    counts = json.loads((ROOT / "results" / "demo.json").read_text())["counts"]
    _, shown = re.split(r"<!-- results/demo.json -->\n", README)
    assert shown.split("<!-- end -->")[0].strip() == metrics.markdown(counts).strip()


def test_the_benchmarks_are_those_of_the_committed_results():
    document = json.loads((ROOT / "results" / "bench.json").read_text())
    _, shown = README.split("<!-- results/bench.json -->\n")
    assert shown.split("<!-- end -->")[0].strip() == bench.markdown(document).strip()


def test_the_variants_are_those_of_the_committed_results():
    document = json.loads((ROOT / "results" / "sweep.json").read_text())
    _, shown = README.split("<!-- results/sweep.json -->\n")
    assert shown.split("<!-- end -->")[0].strip() == sweep.markdown(document).strip()


def test_the_papers_tables_are_those_of_the_committed_results():
    assert write.filled(README, results.load(ROOT / "results")) == README


def test_the_default_never_fails_a_truncation():
    """Of a million at each number of parties; local truncation's failures show that the count counts."""
    failed = {}
    for result in json.loads((ROOT / "results" / "sweep.json").read_text())["results"]:
        if result["status"] == "done":
            of = failed.setdefault(result["protocol"], [])
            of.append(result["truncations"]["failed"])
            assert result["truncations"]["of"] >= 10**6
    assert failed["default"] == [0] * len(failed["default"])
    assert sum(failed["truncation=local"]) > 0


def test_the_demo_shows_the_point():
    """Camera views clearly ahead of map only; secret within three points of plaintext on the same data."""
    accuracy = json.loads((ROOT / "results" / "demo.json").read_text())["accuracy"]
    assert accuracy["plaintext"] > accuracy["map-only"] + 10
    for secret in ("secret-2", "secret-5"):
        assert accuracy[secret] > accuracy["plaintext"] - 3


BLOCK = re.compile(r"```(python|text)\n(.*?)```", re.DOTALL)


@pytest.fixture(scope="module")
def ran():
    """The names left by the README's code about secrets, and what each block printed with what is shown."""
    names, printed = {}, []
    section = README[README.index("## Secret sharing") : README.index("## What is secret")]
    for language, text in BLOCK.findall(section):
        if language == "text":
            printed[-1][1] = text
            continue
        with contextlib.redirect_stdout(io.StringIO()) as out:
            exec(compile(text, "example.py", "exec"), names)  # the README's own code
        printed.append([out.getvalue(), None])
    return names, printed


def test_the_example_runs(ran):
    names, printed = ran
    plain = jax.grad(names["loss"])(names["w"], names["x"], names["y"])
    np.testing.assert_allclose(names["cn"].reveal(names["gradient"]), plain, atol=1e-4)
    assert printed[0][0].startswith("(5, 3, 2)")


def test_the_loop_on_secrets_is_the_plain_loop(ran):
    names, _ = ran
    plain = names["train"](names["w"], names["x"], names["y"])
    np.testing.assert_allclose(names["cn"].reveal(names["trained"]), plain, atol=1e-3)


def test_the_outputs_shown_are_those_of_the_code(ran):
    shown = [(out, text) for out, text in ran[1] if text is not None]
    assert len(shown) == 3
    for out, text in shown:
        assert out == text
