"""The README's numbers come from committed JSON, and its example runs."""

import json
import re
from pathlib import Path

import jax
import numpy as np

from ciphernav_jax.experiments import bench
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


def test_the_demo_shows_the_point():
    """Camera views clearly ahead of map only; secret within three points of plaintext on the same data."""
    accuracy = json.loads((ROOT / "results" / "demo.json").read_text())["accuracy"]
    assert accuracy["plaintext"] > accuracy["map-only"] + 10
    for secret in ("secret-2", "secret-5"):
        assert accuracy[secret] > accuracy["plaintext"] - 3


def test_the_example_runs(capsys):
    example = next(
        block for block in re.findall(r"```python\n(.*?)```", README, re.DOTALL) if "cn.secure" in block
    )
    names = {}
    exec(example, names)  # the README's own code
    plain = jax.grad(names["loss"])(names["w"], names["x"], names["y"])
    np.testing.assert_allclose(names["cn"].reveal(names["gradient"]), plain, atol=1e-4)
    assert capsys.readouterr().out.startswith("(5, 3, 2)")
