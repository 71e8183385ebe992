"""The report's figures, mostly one panel, for a phone: as SVG for the page, as PNG for the pages."""

import io
import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ciphernav_jax.comparison import pictures
from ciphernav_jax.comparison.pictures import COLOURS
from ciphernav_jax.navigation import metrics, paper
from experiments.report.engine import compared
from experiments.report.results import Document, Results, overall_accuracy, spread
from experiments.report.table import CHEAP, SETS, made_by, script, title

LENGTHS = ("map-only", "first-person-deterministic", "secret-2", "secret-5", "plaintext")
"""Rows that are compared by path length, in the order of `COLOURS`."""

GREY = "#8C8C8C"
DPI = 90

Line = Mapping[int, float]
"""y by x, which rises."""

# A colour that stands for that of the page's text, whatever it is; see `svg`.
INK = "#010203"
INKED = {
    name: INK
    for name in (
        "text.color",
        "axes.labelcolor",
        "axes.edgecolor",
        "xtick.color",
        "ytick.color",
        "grid.color",
    )
}


@dataclass(frozen=True)
class Picture:
    """A figure of the report.

    Attributes:
        name: of its PNG.
        title: what it shows.
        note: what one sees.
        draw: makes it; None where no file is there.
        missing: commands that make what is not there.
        wide: whether it has several panels.
    """

    name: str
    title: str
    note: str
    draw: Callable[[], Figure] | None
    missing: tuple[str, ...] = ()
    wide: bool = False


def every(results: Results) -> Iterator[Picture]:
    """All figures in their order."""
    yield overall(results)
    yield by_length(results, "success")
    yield by_length(results, "failure")
    yield secret_curves(results)
    yield paper_curves(results)
    yield sweep(results)


def overall(results: Results) -> Picture:
    """Accuracy of every method at a glance."""
    names = [name for name in paper.TABLE if name in results.runs]

    def draw() -> Figure:
        figure, axes = _panel()
        places = range(len(names), 0, -1)
        for number, (test_set, words) in enumerate(SETS.items()):
            found = [spread(results.runs[n], lambda d, s=test_set: overall_accuracy(d, s)) for n in names]
            beside = [place - 0.2 * number for place in places]
            means, sds = [s.mean for s in found], [s.sd or 0.0 for s in found]
            axes.errorbar(
                means, beside, xerr=sds, fmt="o", ms=4, color=COLOURS[number], label=f"ours, {words}"
            )
        theirs = [paper.TABLE[name].overall for name in names]
        axes.plot(theirs, places, "|", color=GREY, ms=16, mew=2.5, label="the paper")
        axes.set_yticks(places, [title(name) for name in names])
        axes.set(xlabel="overall accuracy (%)", ylim=(0.5, len(names) + 0.5))
        return _legend(figure, 3)

    note = "Means over seeds, with sample standard deviations where they are wider than the dots."
    missing = made_by(results, paper.TABLE)
    return Picture("overall", "Accuracy beside the paper's", note, draw if names else None, missing)


COINCIDE = "Lines that coincide are drawn in one another."


def by_length(results: Results, what: str) -> Picture:
    """Successes or failures of a run by the length of the shortest path, as in the paper's figure."""
    names = [name for name in LENGTHS if name in results.runs]

    def draw() -> Figure:
        figure, axes = _panel()
        lines = {name: episodes_by_length(results.runs[name], what) for name in names}
        for (name, line), width in zip(lines.items(), widths(list(lines.values())), strict=True):
            colour = COLOURS[LENGTHS.index(name)]
            axes.plot(*_xy(line), color=colour, lw=width, marker="o", ms=width + 2.5, label=title(name))
        axes.set(xlabel="moves of the shortest path", ylabel="episodes a seed", ylim=(0, None))
        return _legend(figure, 2)

    return Picture(
        f"{what}-by-length",
        f"{what.capitalize()} by path length",
        f"Episodes that end in {what}, all seeds added up and divided by their number; independent test set. "
        f"{COINCIDE}",
        draw if names else None,
        made_by(results, LENGTHS),
    )


def episodes_by_length(documents: list[Document], what: str) -> Mapping[int, float]:
    """How many episodes with paths of each length end in success or in failure, per seed."""
    counts: dict[int, float] = {}
    for document in documents:
        for length, halves in document["results"]["test"]["by_length"].items():
            both = metrics.overall(halves)
            number = both["success"] if what == "success" else both["trials"] - both["success"]
            counts[int(length)] = counts.get(int(length), 0.0) + number / len(documents)
    return dict(sorted(counts.items()))


def secret_curves(results: Results) -> Picture:
    """The losses of secret trainings, with the same in plaintext."""
    names = [name for name in (*CHEAP, "plaintext-classifier") if name in results.runs]
    return Picture(
        "curves",
        "Training from scratch under secret sharing",
        "The loss, summed over a chunk of steps, and the right answers of its last batch are all that is "
        f"opened. A line for each seed. {COINCIDE}",
        (lambda: _curves(results, names)) if names else None,
        made_by(results, (*CHEAP, "plaintext-classifier")),
    )


def paper_curves(results: Results) -> Picture:
    """The losses of the paper's own recipe."""
    names = sorted(name for name in results.runs if name.startswith("paper-recipe"))
    compared = [name for name in ("secret-2",) if name in results.runs]
    return Picture(
        "paper-recipe",
        "The paper's recipe beside ours",
        "SGD with learning rate 0.01, as the paper says, and ours with two parties. With 500 samples a step "
        f"the line in secret lies on the one in plaintext. {COINCIDE}",
        (lambda: _curves(results, names + compared, log_steps=True)) if names else None,
        () if names else (script("paper_recipe"),),
    )


def sweep(results: Results) -> Picture:
    """The picture of a comparison of variants."""
    found = compared(results)
    return Picture(
        "sweep",
        "Variants of the protocols: a picture of the same step",
        "Each variant has a mark of its own, hollow where it is no protocol.",
        (lambda: pictures.figure(found.rows, "A training step of the paper's classifier")) if found else None,
        () if found else (script("variants"),),
        wide=True,
    )


def _curves(results: Results, names: list[str], *, log_steps: bool = False) -> Figure:
    figure, axes = _panel()
    lines = {
        name: [
            {point["step"]: point["loss"] for point in document["curve"]} for document in results.runs[name]
        ]
        for name in names
    }
    nested = widths([{x: math.log(y) for x, y in of_seeds[0].items()} for of_seeds in lines.values()])
    for (name, of_seeds), colour, width in zip(lines.items(), COLOURS, nested, strict=False):
        style = "-" if "cost" in results.runs[name][0] else "--"
        for number, line in enumerate(of_seeds):
            axes.plot(*_xy(line), style, color=colour, lw=width, label=None if number else title(name))
    axes.set(
        xlabel="step", ylabel="mean squared error", yscale="log", xscale="log" if log_steps else "linear"
    )
    return _legend(figure, 2)


def widths(lines: Sequence[Line]) -> list[float]:
    """Of lines that are drawn one over the other: each is wider than those above that would hide it."""
    values = [y for line in lines for y in line.values()]
    near = 0.02 * (max(values) - min(values)) if values else 0.0

    def hides(above: Line, below: Line) -> bool:
        x, y = np.array(_xy(below))
        there = (x >= min(above)) & (x <= max(above))
        return bool(there.any()) and np.median(np.abs(np.interp(x, *_xy(above)) - y)[there]) <= near

    return [1.3 + 1.9 * sum(hides(above, below) for above in lines[i + 1 :]) for i, below in enumerate(lines)]


def _xy(line: Line) -> tuple[list[float], list[float]]:
    return list(line), list(line.values())


def _legend(figure: Figure, columns: int) -> Figure:
    figure.legend(frameon=False, loc="outside lower center", ncols=columns, fontsize=8, handletextpad=0.4)
    return figure


def _panel() -> tuple[Figure, Axes]:
    figure = Figure(figsize=(5.6, 4.1), layout="constrained")
    axes = figure.subplots()
    axes.grid(alpha=0.2)
    axes.spines[["top", "right"]].set_visible(False)
    return figure, axes


def svg(picture: Picture) -> str:
    """A figure to stand in a page: transparent, in the colour and with the font of the text around it."""
    assert picture.draw is not None
    settings: dict[Any, Any] = INKED | {
        "svg.fonttype": "none",
        "svg.hashsalt": picture.name,
        "savefig.transparent": True,
    }
    with matplotlib.rc_context(settings):
        file = io.StringIO()
        picture.draw().savefig(file, format="svg", metadata={"Date": None, "Creator": None})
    drawn = file.getvalue()
    drawn = drawn[drawn.index("<svg") :]
    for ink in (INK, "#000000", pictures.GREY):
        drawn = re.sub(ink, "currentColor", drawn, flags=re.IGNORECASE)
    drawn = re.sub(r"<metadata>.*?</metadata>", "", drawn, flags=re.DOTALL)  # it names other sites
    return drawn.replace("<svg ", f'<svg role="img" aria-label="{picture.title}" ', 1)
