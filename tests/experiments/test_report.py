import base64
import io
import re
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest
from PIL import Image, ImageSequence

from ciphernav_jax import files
from ciphernav_jax.comparison import Comparison, Row
from ciphernav_jax.navigation import paper
from ciphernav_jax.world.poses import IMAGE_SHAPE
from experiments.paper.attack import ATTACKERS
from experiments.report import (
    attacks,
    costs,
    driving,
    engine,
    figures,
    listing,
    minutes,
    page,
    results,
    shown,
    write,
)
from experiments.report.table import duration

pytestmark = pytest.mark.slow

MACHINE = {"machine": {"processor": "abacus", "cpus": 2}, "versions": {"jax": "1.2.3"}}


def counts(detour: int, no_detour: int, trials: int = 10) -> dict:
    """All failures are crashes with obstacles; all successes are efficient but for one without a detour."""
    return {
        half: {
            "trials": trials,
            "success": success,
            "efficient": success - lost,
            "crash_obstacle": trials - success,
            "crash_wall": 0,
            "no_crash": 0,
        }
        for half, success, lost in (("detour", detour, 0), ("no_detour", no_detour, 1))
    }


def run(row: str, seed: int, detour: int = 8, no_detour: int = 9, *, parties: int | None = None) -> dict:
    of = counts(detour, no_detour)
    point = {"step": 50, "loss": 0.5, "accuracy": 40.0, "seconds": 1.0}
    made = {"truncations": 1000, "failed": seed} if parties else {}
    document = {
        "row": row,
        "seed": seed,
        "curve": [point | made, point | made | {"step": 100, "loss": 0.1}],
        "seconds": {"train": 2.0 + seed, "compile": 12.0},
        "results": {
            name: {"counts": of, "by_length": {"1": counts(10, 10), "12": counts(detour, no_detour)}}
            for name in ("test", "unseen")
        },
        **MACHINE,
    }
    if parties:
        cost = {"rounds": 35, "bytes_sent": 7e6, "bytes_dealt": 21e6, "seconds": {"LAN": 0.02, "WAN": 3.0}}
        document["epochs"] = 1.4567
        document["cost"] = {"training step": cost, "decision": cost | {"rounds": 26}}
    return document


def careful(row: str, seed: int, *, alone: int) -> dict:
    """With two robots lost, half of them in each set, of which `alone` and twice as many plan alone."""
    document = run(row, seed, 10, 10)
    for factor, result in enumerate(document["results"].values(), 1):
        result["counts"]["detour"] |= {"success": 9, "efficient": 9, "no_crash": 1}
        result["alone"] = factor * alone
    return document


def view(seed: int) -> str:
    """A view as PNG in base64."""
    pixels = np.random.default_rng(seed).integers(0, 256, IMAGE_SHAPE, np.uint8)
    file = io.BytesIO()
    Image.fromarray(pixels).save(file, format="png")
    return base64.b64encode(file.getvalue()).decode()


def episodes(parties: int = 2) -> dict:
    def share(step: int, width: int) -> str:
        return base64.b64encode(np.random.default_rng(step).bytes(parties * width)).decode()

    cameras = ("bottom_left", "bottom_right", "top_left", "top_right")
    obstacle = {"cell": 2, "shape": 1, "colour": 3, "x": 5.5, "z": 1.0, "yaw": 0.0}
    episode = {
        "environment": 7,
        "scenario": {"layout": 11, "start_heading": 3, "goal": 5, "obstacles": [obstacle]},
        "cells": [0, 1, 0, 5],
        "actions": [4, 3, 2, 0],
        "shortest": 2,
        "detour": False,
        "outcome": "success",
        "views": {camera: view(i) for i, camera in enumerate(cameras)},
    }
    steps = [
        {"view": view(10 + i), "shares": {"agent": share(i, 32), "map": share(i, 128)}} for i in range(4)
    ]
    watched = episode | {"steps": steps, "shares": {camera: share(9, 32) for camera in cameras}}
    crash = episode | {"outcome": "crash_obstacle", "cells": [0, 1], "actions": [4, 4], "shortest": 9}
    return {
        "seed": 0,
        "driver": f"secret-{parties}",
        "parties": parties,
        "watched": watched,
        "episodes": {"success": [episode], "failure": [crash], "inefficient": []},
        **MACHINE,
    }


def others() -> dict[str, dict]:
    quarters = {"median": 0.005, "q1": 0.004, "q3": 0.006}
    score = {"hits": 51, "trials": 100, "accuracy": 51.0, "interval": [41.3, 60.6]}
    attack = {"words": 32, "train": {"top_left": 9}, "linear": {"all": score}, "mlp": {"all": score}}
    found = {
        "linear": {"balanced": 80.0, "auc": 90.0, "exact": score},
        "mlp": {"balanced": 85.0, "auc": 88.0},
    }
    found["mlp"]["exact"] = score
    colours = {"most frequent": score, "answers": {"linear": score, "mlp": score | {"accuracy": 52.0}}}
    guesses = {
        name: {"top_left": score, "bottom_left": score | {"accuracy": 49.0, "hits": 49}} for name in ATTACKERS
    }
    seen = {"words": 1000, "read": 0, "compared": 1, "repeated": 2}
    own_runs = {
        f"parties {i} of 2": {"exact": {"a": seen, "b": seen}, "learned": {"training, beside test": guesses}}
        for i in range(2)
    }
    answers = {"obstacles": {"layout": found, "answers": found}, "shape": colours, "colour": colours}
    return {
        "forward-cpu": {
            "device": {"platform": "cpu", "kind": "abacus"},
            "results": [{"name": "2 parties", "parties": 2, "weights": "secret", "seconds": quarters}],
        },
        "bounds": {
            "results": {
                "map": {
                    "test": {"detour": 78.56, "no_detour": 72.61, "overall": 75.58},
                    "unseen": {"detour": 80.0, "no_detour": 80.0, "overall": 80.01},
                }
            }
        },
        "reconstruction-0": {"results": {"features": attack, "share": attack}},
        "own_runs-0": {"results": own_runs},
        "queries-0": {"results": answers},
        "variants": variants(),
        "episodes-0": episodes(),
    }


def variants() -> dict:
    rows = [
        Row("default", 2, False, seconds=0.25, rounds=35, error=1e-5),
        Row("multiplication=ideal", 2, True, seconds=0.125, error=1e-5),
    ]
    configuration = {"function": "sgd_step", "seed": 0, "reference": "float64"}
    comparison = Comparison(tuple(rows), configuration, MACHINE["versions"], MACHINE["machine"])
    trained = {"steps": 100, "loss": 1.5, "exact": 1.25, "value": 3e4, "truncations": 1 << 20, "failed": 1864}
    return {
        "comparison": comparison.as_dict(),
        "trained": [trained | {"protocol": row.protocol, "ideal": row.ideal} for row in rows],
    }


@pytest.fixture
def folder(tmp_path):
    """Result files of a few rows and of every other script."""
    runs = [run("map-only", seed, 6 + seed) for seed in range(3)]
    runs += [run("secret-2", seed, parties=2) for seed in range(2)]
    runs += [run("secret-16", 0, parties=16), run("paper-recipe-samples", 0)]
    runs += [run("longer-2", seed) for seed in range(2)]
    runs += [careful("beyond-2", seed, alone=1 + seed) for seed in range(2)]
    documents = {f"{document['row']}-{document['seed']}": document for document in runs}
    for name, document in (documents | {k: v | MACHINE for k, v in others().items()}).items():
        files.write_json(tmp_path / "paper" / f"{name}.json", document)
    return tmp_path


@pytest.fixture
def loaded(folder):
    return results.load(folder)


def row(table, title):
    return dict(zip(table.header, next(row for row in table.rows if row[0] == title), strict=True))


def test_a_mean_and_a_sample_standard_deviation_over_seeds(loaded):
    found = results.spread(
        loaded.runs["map-only"], lambda d: d["results"]["test"]["counts"]["detour"]["success"]
    )
    assert found == (7.0, 1.0)  # of 6, 7, 8: the variance is (1 + 0 + 1) / 2
    assert found.text() == "7.00 ± 1.00"
    assert results.spread([run("random", 0)], lambda d: 3.0) == (3.0, None)


def test_accuracy_stands_beside_the_papers(loaded):
    table = driving.accuracy(loaded, "test")
    cells = row(table, "Map only")
    assert cells["seeds"] == "3"
    assert (cells["detour: paper"], cells["detour: ours"]) == ("64.3", "70.00 ± 10.00")
    # 15, 16 and 17 of 20; the paper's overall is 74.0, printed as such
    assert (cells["overall: paper"], cells["overall: ours"]) == ("74.0", "80.00 ± 5.00")
    assert row(table, "16 parties, cameras")["seeds"] == "one"
    assert row(table, "16 parties, cameras")["detour: ours"] == "80.00"
    assert [cells[0] for cells in table.rows[-2:]] == [
        "16 parties, cameras",
        "Paper's recipe, 500 samples a step",
    ]
    assert "SGD" in table.note
    assert driving.accuracy(loaded, "unseen").header == ("method", "seeds", "detour", "no detour", "overall")


def test_failures_are_scaled_to_the_papers_trials(loaded):
    cells = row(driving.failures(loaded, "test"), "2 parties, cameras")
    assert cells["obstacle: ours"] == f"{3 / 20 * paper.TRIALS:.1f} ± 0.0"
    assert cells["obstacle: paper"] == "144"


def test_efficiency_is_of_the_successes(loaded):
    cells = row(driving.efficiency(loaded, "test"), "2 parties, cameras")
    assert cells["detour: ours"] == "100.00 ± 0.00"
    assert cells["no detour: ours"] == f"{100 * 8 / 9:.2f} ± 0.00"


def test_careful_robots_stand_beside_the_same_trainings(loaded):
    table = driving.beyond(loaded)
    titles = ["2 parties, cameras", "2 parties, trained longer", "2 parties, trained longer, careful robot"]
    assert [cells[0] for cells in table.rows] == titles
    cells = row(table, titles[-1])
    assert cells["independent test set: accuracy"] == "95.00 ± 0.00"
    assert cells["independent test set: efficient"] == f"{100 * 18 / 19:.2f} ± 0.00"
    assert cells["independent test set: lost"] == "2"
    assert cells["independent test set: alone"] == "7.50 ± 3.54"  # 1 and 2 of 20
    assert cells["unseen layouts: alone"] == "15.00 ± 7.07"
    assert [row(table, title)["unseen layouts: alone"] for title in titles[:2]] == ["", ""]
    assert "python -m experiments paper beyond --rows longer-5 beyond-5" in " ".join(table.missing)


def test_what_training_in_secret_takes(loaded):
    cells = row(costs.cost(loaded), "2 parties, cameras")
    assert cells["trained in"] == "2.5 s"  # the mean of 2 and 3
    assert cells["ms a step"] == "25"
    assert (cells["steps"], cells["epochs"]) == ("100", "1.5")
    assert cells["messages: WAN"] == "5 min"  # 100 steps of 3 s
    theirs = row(costs.cost(loaded), "The paper, on a GPU")
    assert (theirs["trained in"], theirs["accuracy"]) == ("3 days", "96.6 / 96.9")
    assert theirs["epochs"] == "600"


def test_ten_epochs_and_more_are_shown_whole(loaded):
    (document, *_) = loaded.runs["secret-2"]
    document["epochs"] = 600.8
    assert row(costs.cost(loaded), "2 parties, cameras")["epochs"] == "601"


def test_messages_of_a_step_and_of_a_decision(loaded):
    cells = row(costs.messages(loaded), "2 parties, cameras")
    assert (cells["step: rounds"], cells["step: MB sent"], cells["step: MB dealt"]) == ("35", "7", "21")
    assert (cells["decision: rounds"], cells["decision: LAN ms"]) == ("26", "20")


def test_truncations_are_added_up(loaded):
    table = costs.audit(loaded)
    assert table.rows[-1] == ("All", "3", "6,000", "2")  # two chunks of three runs; seed 1 fails one in each


def test_the_other_scripts_have_their_tables(loaded):
    assert driving.bounds(loaded).rows == [("Map", "78.6", "72.6", "75.6", "80.0")]
    assert costs.forward(loaded).rows == [
        ("2 parties", "secret", "abacus", "5", "4-6", "230", "150"),
    ]
    learned = {cells[0]: cells[3:] for cells in attacks.reconstruction(loaded).rows}
    assert learned["Features"] == ("93.6", "51.0 (41.3-60.6)", "51.0 (41.3-60.6)")
    shares = "50.0 (49.0-51.0)"
    assert attacks.own_runs(loaded).rows == [
        (f"Parties {i} of 2", "2,000", "0", "2", "4", shares, shares, shares) for i in range(2)
    ]
    asked = {cells[0]: cells[1:] for cells in attacks.queries(loaded).rows}
    assert asked["Answers"] == ("85.0", "90.0", "51.0", "52.0", "52.0")  # of the better attacker
    assert asked["Layout"][-2:] == ("", "")


def test_how_long_the_scripts_take_comes_from_their_files(folder):
    document = files.read_json(folder / "paper" / "queries-0.json")
    files.write_json(folder / "paper" / "queries-0.json", document | {"seconds": {"ask": 80.0, "all": 285.0}})
    document = files.read_json(folder / "paper" / "bounds.json")
    files.write_json(folder / "paper" / "bounds.json", document | {"seconds": 8.0})
    table = minutes.minutes(results.load(folder))
    told = {cells[0].strip("`").rpartition(" ")[-1]: cells[1:4] for cells in table.rows}
    # Six runs of 2 + seed and 12 seconds: three and two and one seeds.
    assert told["accuracy"] == ("6", "88 s", "16 s")
    assert told["paper_recipe"] == ("1", "14 s", "14 s")
    assert told["beyond"] == ("4", "58 s", "15 s")
    assert told["queries"] == ("1", "4.75 min", "4.75 min")
    assert told["bounds"] == ("1", "8 s", "8 s")
    assert told["forward"] == told["episodes"] == ("1", "not measured", "not measured")
    assert {cells[-1] for cells in table.rows} == {"not measured"}  # no benchmark, which has the memory


def test_variants_are_compared_and_trained_with(loaded):
    table = engine.variants(loaded)
    assert (row(table, "default")["ms"], row(table, "default")["rounds"]) == ("250", "35")
    ideal = "multiplication=ideal (ideal: not a protocol)"
    assert row(table, ideal)["ms"] == "125"
    assert table.note.startswith(
        "sgd_step on 2 cores of abacus, jax 1.2.3, seed 0. Milliseconds of a warm call"
    )
    assert engine.trained(loaded).rows == [
        (name, "100", "1.5", "1.25", "+20 %", "30,000", "1,048,576", "1,864") for name in ("default", ideal)
    ]


def test_no_line_is_hidden_by_another():
    low, high, other = {1: 0.0, 2: 0.01, 3: 0.0}, {2: 0.0, 3: 0.0, 9: 1.0}, {1: 1.0, 2: 1.0, 3: 0.5}
    lone, inner, outer = 1.3, 3.2, 5.1
    assert figures.widths([low, other]) == [lone, lone]
    assert figures.widths([low, high]) == [inner, lone]
    assert figures.widths([low, other, low, low]) == [outer, lone, inner, lone]
    assert figures.widths([{1: 0.0}, {2: 0.0}]) == [lone, lone]  # nowhere side by side


def test_runs_that_do_the_same_are_all_seen(loaded):
    same = {name: loaded.runs["secret-2"] for name in figures.LENGTHS}
    picture = figures.by_length(replace(loaded, runs=same), "success")
    assert picture.draw is not None
    axes = picture.draw().axes[0]
    found = [line.get_linewidth() for line in axes.lines]
    assert found == sorted(set(found), reverse=True)
    assert len(found) == len(figures.LENGTHS)


def test_what_is_missing_is_said_with_the_command_that_makes_it(tmp_path):
    found = results.load(tmp_path)
    for table in listing.every(found):
        assert not table.rows
        assert table.missing
        assert "|" not in table.markdown()
    assert all(picture.draw is None and picture.missing for picture in figures.every(found))
    text = page.page(found)
    assert "<table" not in text
    for script in (
        "accuracy --rows random",
        "fewest_steps",
        "forward",
        "bounds",
        "reconstruction",
        "own_runs",
        "episodes",
    ):
        assert f"python -m experiments paper {script}" in text
    assert "python -m experiments paper variants" in text
    with pytest.raises(FileNotFoundError, match="--results"):
        results.load(tmp_path / "nowhere")


def test_rows_that_are_missing_are_named(loaded):
    missing = driving.accuracy(loaded, "test").missing
    assert "--rows random first-person" in missing[0]
    assert "map-only" not in " ".join(missing)
    assert missing[1].endswith("--rows secret-3 secret-9 --seeds 0")


def test_lengths_are_of_all_seeds_together(loaded):
    lengths = figures.episodes_by_length(loaded.runs["map-only"], "failure")
    assert lengths == {1: 0, 12: pytest.approx((4 + 3 + 2) / 3 + 1)}


class Links(HTMLParser):
    """What a page would load, and the tags that are open."""

    def __init__(self):
        super().__init__()
        self.loaded, self.open = [], []

    def handle_starttag(self, tag, attrs):
        if tag not in ("meta", "link", "img", "input", "br"):
            self.open.append(tag)
        self.loaded += [
            value for name, value in attrs if name.rpartition(":")[2] in ("src", "href", "srcset", "data")
        ]

    def handle_startendtag(self, tag, attrs):
        self.handle_starttag(tag, attrs)
        self.open.pop()

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


def test_the_page_loads_nothing(folder):
    write.write_report(folder, folder / "out")
    text = (folder / "out" / "report.html").read_text()
    links = Links()
    links.feed(text)
    assert links.open == []
    assert all(link.startswith(("data:", "#")) for link in links.loaded)
    assert all(
        target in ("#",) or f'id="{target[1:]}"' in text for target in links.loaded if target[0] == "#"
    )
    # A namespace is a name, not an address to load from.
    assert set(re.findall(r"https?://[^\"' ]+", text)) <= {
        "http://www.w3.org/2000/svg",
        "http://www.w3.org/1999/xlink",
    }
    assert re.search(r"url\((?!#)", text) is None
    assert figures.INK not in text
    assert "currentColor" in text


def test_the_page_says_a_thing_once_and_folds_nothing(loaded):
    text = page.page(loaded)
    driver = re.search(r"From above, as nobody sees it. ([^<]*)</p>", text)[1]
    assert driver == "2 parties, cameras, seed 0."
    pictures = re.findall(r'<figure><img alt="([^"]*)" .*?<figcaption>([^<]*)</figcaption>', text, re.DOTALL)
    assert pictures
    assert all(alt not in caption for alt, caption in pictures)
    captions = re.findall(r"<h3>([^<]*)</h3>", text)
    assert len(captions) == len(set(captions))
    assert "<figcaption></figcaption>" not in text
    assert "<details" not in text
    assert {name for section in page.SECTIONS for name in section.parts} >= {"variants", "sweep", "trained"}


def test_the_files_are_whole(folder):
    write.write_report(folder, folder / "out")
    made = {path.name for path in (folder / "out").iterdir()}
    assert {"report.html", "paper.md", "overall.png", "curves.png", "episodes.png", "episode.gif"} <= made
    assert "noise.png" in made
    assert not any(name.endswith(".part") for name in made)
    assert "sweep.png" in made
    assert np.asarray(Image.open(folder / "out" / "success-by-length.png")).std() > 10
    assert len(ImageSequence.all_frames(Image.open(folder / "out" / "episode.gif"))) == 4
    markdown = (folder / "out" / "paper.md").read_text()
    table = driving.accuracy(results.load(folder), "test")
    assert f"<!-- report: accuracy-test -->\n{table.markdown()}\n<!-- end -->" in markdown
    assert "| Map only | 3 | 64.3 | 70.00 ± 10.00 |" in markdown


def test_a_readmes_blocks_are_filled_with_its_tables(folder):
    readme = folder / "README.md"
    readme.write_text(
        "Before\n<!-- report: bounds -->\n<!-- end -->\nand\n<!-- report: cost -->\nold\n<!-- end -->\n"
    )
    loaded = results.load(folder)
    write.write_report(folder, folder / "out", readme)
    expected = "\n".join(
        f"{text}\n<!-- report: {found.name} -->\n{found.markdown()}\n<!-- end -->"
        for text, found in (("Before", driving.bounds(loaded)), ("and", costs.cost(loaded)))
    )
    assert readme.read_text() == expected + "\n"
    assert write.filled(expected, loaded) == expected
    with pytest.raises(ValueError, match="no table nothing"):
        write.filled("<!-- report: nothing -->\n<!-- end -->", loaded)


def test_a_party_sees_its_own_and_noise():
    document = episodes(parties=5)
    frame = list(shown.frames(document["watched"], 5))[1]
    own = {
        party: slot
        for party, slot in enumerate(("agent", "bottom_left", "bottom_right", "top_left", "top_right"))
    }
    for (party, slot), tile in frame.tiles.items():
        if slot == own[party]:
            source = document["watched"]["views"].get(slot) or document["watched"]["steps"][1]["view"]
            np.testing.assert_array_equal(tile, shown.unpacked(source))
        elif (party, slot) != (0, "map"):
            assert tile.shape == ((8, 16) if slot == "map" else (4, 8))
    assert frame.tiles[0, "map"].shape == (90, 90, 3)
    assert "opened: left" in frame.caption


def test_durations_have_the_unit_that_fits():
    said = [duration(seconds) for seconds in (1.5, 119, 130, 7300, 3 * 86400)]
    assert said == ["1.5 s", "119 s", "2.17 min", "2.03 h", "3 days"]
