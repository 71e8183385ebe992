"""The pages: their numbers come from committed JSON, their links lead somewhere, and their code runs."""

import json
import re
from pathlib import Path

import jax
import numpy as np
import pytest
from PIL import Image

from ciphernav_jax.navigation import metrics
from experiments import bench
from experiments import pages as made
from experiments.report import results, write
from tests import pages

ROOT = Path(__file__).parents[1]
RESULTS = ROOT / "experiments" / "results"
DOCS = ROOT / "docs"
README = ROOT / "README.md"
PAGES = sorted(DOCS.rglob("*.md"))
WRITTEN = [README, ROOT / "CONTRIBUTING.md", *PAGES]
LINK = re.compile(r"\]\(([^)\s]+)\)")


def block(page: str, name: str) -> str:
    """What stands on a page of results between the comments of a result file."""
    _, shown = (DOCS / "results" / page).read_text().split(f"<!-- experiments/results/{name} -->\n")
    return shown.split("<!-- end -->")[0].strip()


def result(name: str) -> dict:
    return json.loads((RESULTS / name).read_text())


def test_the_table_is_that_of_the_committed_results():
    assert block("paper.md", "demo.json") == metrics.table(result("demo.json")["counts"]).markdown()


def test_the_benchmarks_are_those_of_the_committed_results():
    assert block("speed.md", "bench.json") == bench.markdown(result("bench.json")).strip()


def test_the_papers_tables_are_those_of_the_committed_results():
    found = results.load(RESULTS)
    for path in WRITTEN:
        text = path.read_text()
        assert write.filled(text, found) == text, path
    shown = write.BLOCK.findall("".join(path.read_text() for path in WRITTEN))
    assert {"short-accuracy", "short-speed", "accuracy-test", "cost", "reconstruction", "queries"} <= set(
        shown
    )
    assert {"variants", "trained"} <= set(shown)


def test_the_readmes_tables_have_their_rows():
    text = README.read_text()
    rows = [part.count("\n| ") - 2 for part in re.findall(r"<!-- report: .*?<!-- end -->", text, re.DOTALL)]
    assert rows == [5, 4]


def test_the_default_never_fails_a_truncation():
    """Of a million; local truncation's failures show that the count counts."""
    failed = {found["protocol"]: found["failed"] for found in result("paper/variants.json")["trained"]}
    assert all(found["truncations"] >= 10**6 for found in result("paper/variants.json")["trained"])
    assert failed["default"] == 0
    assert failed["truncation=local"] > 0


def test_the_variants_are_compared_on_the_step_that_the_paper_s_runs_count():
    counted = result("paper/secret-5-0.json")["cost"]["training step"]
    (row,) = (
        row
        for row in result("paper/variants.json")["comparison"]["rows"]
        if (row["protocol"], row["parties"]) == ("default", 5)
    )
    for name in ("rounds", "bytes_sent", "bytes_dealt"):
        assert row[name] == counted[name]
    said = f"Each of 5 parties: {counted['rounds']} rounds, {counted['bytes_sent'] / 1e6:.3g} MB sent."
    assert said in (DOCS / "guide" / "costs.md").read_text()


def test_the_demo_shows_the_point():
    """Camera views clearly ahead of map only; secret within three points of plaintext on the same data."""
    accuracy = result("demo.json")["accuracy"]
    assert accuracy["plaintext"] > accuracy["map-only"] + 10
    for secret in ("secret-2", "secret-5"):
        assert accuracy[secret] > accuracy["plaintext"] - 3


def test_the_readme_is_short_and_says_first_how_to_install():
    lines = README.read_text().splitlines()
    assert len(lines) <= 200
    assert "## Install" in lines[:40]


def test_every_page_stands_in_the_navigation():
    listed = re.findall(r"[\w/-]+\.md", (ROOT / "mkdocs.yml").read_text())
    assert sorted(listed) == sorted(str(path.relative_to(DOCS)) for path in PAGES)


@pytest.mark.parametrize("page", WRITTEN, ids=lambda path: str(path.relative_to(ROOT)))
def test_links_lead_somewhere(page):
    for target in LINK.findall(pages.BLOCK.sub("", page.read_text())):
        if target.startswith("#"):
            target = page.name + target
        name, _, heading = target.partition("#")
        assert "://" not in target, "a page links to pages of its own"
        path = (page.parent / name).resolve()
        assert path.exists(), target
        if page in PAGES:  # the site holds nothing else
            assert path.is_relative_to(DOCS), target
        if heading:
            titles = re.findall(r"^#+ (.*)", path.read_text(), re.MULTILINE)
            assert heading in {re.sub(r"[^\w -]", "", t).lower().replace(" ", "-") for t in titles}, target


def test_every_picture_is_shown_and_small():
    shown = {
        (page.parent / target).resolve()
        for page in WRITTEN
        for target in LINK.findall(page.read_text())
        if target.endswith((".png", ".gif"))
    }
    there = {path for path in DOCS.rglob("*") if path.suffix in (".png", ".gif")}
    assert shown == there
    assert all(path.stat().st_size < 300_000 for path in there)


def test_the_public_names_are_those_of_the_package():
    assert (DOCS / "api.md").read_text() == made.api()


def test_the_layouts_are_those_of_the_world():
    kept = np.asarray(Image.open(DOCS / "pictures" / "layouts.png").convert("RGB"), float)
    assert np.abs(kept - np.asarray(made.layouts().convert("RGB"), float)).mean() < 1  # but for fonts


CODED = [path for path in (README, *PAGES) if "```python\n" in path.read_text()]


@pytest.mark.slow
@pytest.mark.parametrize("page", CODED, ids=lambda path: str(path.relative_to(ROOT)))
def test_the_code_prints_what_is_shown(page, tmp_path):
    text, names = page.read_text(), {}
    for ran in pages.run(text, tmp_path, names):
        assert ran.printed == (ran.shown or ran.printed)
        assert bool(ran.printed) == bool(ran.shown), "an output that is not shown, or none that is"
    if page == README:
        plain = jax.grad(names["loss"])(names["w"], names["x"], names["y"])
        np.testing.assert_allclose(names["cn"].reveal(names["gradient"]), plain, atol=1e-4)


def test_code_that_does_not_run_says_why():
    for page in WRITTEN:
        text = page.read_text()
        assert text.count("```python no-run") == text.count("<!-- not run: "), page
