"""The rows of a comparison as a picture.

Nothing is drawn over anything else: each variant has a place of its own beside every number of parties, and a
line of its own among the errors, in which each number of parties has a height of its own.
"""

import math
import textwrap
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Literal

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import LogLocator, NullFormatter

from ciphernav_jax.comparison.rows import Row
from ciphernav_jax.files import write_png

# Okabe and Ito's colours. Variants beyond them have the same ones in another shape.
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
SHAPES = "osD^vP*X"
GREY = "#555555"
SMALL, TINY = 8, 6.5
LARGEST_MARK = 6.0
# Of the distance between two numbers of parties, or two variants: what is taken by what stands there.
WIDTH = 0.7

Direction = Literal["x", "y"]
Value = Callable[[Row], float | None]
Style = dict[str, tuple[str, str]]  # of each variant colour and shape


def draw(rows: Sequence[Row], title: str, path: Path) -> None:
    """Write `figure` as a PNG, whole or not at all."""
    write_png(path, figure(rows, title), dpi=100)


def figure(rows: Sequence[Row], title: str) -> Figure:
    """Four panels: seconds, and projected seconds of messages, by parties; errors of values and, where
    there are any, of gradients by variant. What has no number is said in words.
    """
    variants = list(dict.fromkeys(row.protocol for row in rows))
    parties = sorted({row.parties for row in rows})
    style = {
        name: (COLOURS[i % len(COLOURS)], SHAPES[i // len(COLOURS) % len(SHAPES)])
        for i, name in enumerate(variants)
    }
    ideal = {row.protocol for row in rows if row.ideal}
    names = [name + " (ideal: not a protocol)" * (name in ideal) for name in variants]
    wrapped = [textwrap.fill(name, 40) for name in names]
    # Inches: so much for what is written beside each variant, and for what stands in its line.
    lines = max(name.count("\n") + 1 for name in wrapped)
    above, below = (
        3.3 + 0.2 * len(variants),
        0.9 + len(variants) * (0.1 + max(0.13 * lines, 0.14 * len(parties))),
    )
    shown = Figure(figsize=(11, above + below), layout="constrained")
    shown.suptitle(title, fontsize=11)
    upper, lower = shown.subfigures(2, 1, height_ratios=[above, below], squeeze=False).flat
    seconds, messages = upper.subplots(1, 2)
    _by_parties(seconds, rows, lambda row: row.seconds, style, parties, "Seconds of a call")
    _by_parties(
        messages, rows, lambda row: row.wan_seconds, style, parties, "Seconds of messages on a WAN, projected"
    )
    upper.legend(
        handles=[
            Line2D(
                [], [], color=colour, marker=shape, ls="", label=name, mfc=_filling(colour, variant in ideal)
            )
            for name, (variant, (colour, shape)) in zip(names, style.items(), strict=True)
        ],
        loc="outside lower center",
        ncols=2 if len(variants) > 3 else 1,
        fontsize=SMALL,
        frameon=False,
    )
    panels: list[tuple[str, Value]] = [("Largest error of a value", lambda row: row.error)]
    if any(row.gradient_error is not None for row in rows):
        panels.append(("Largest error of a gradient's entry", lambda row: row.gradient_error))
    errors = lower.subplots(1, len(panels), sharey=True, squeeze=False)[0]
    for axes, (what, value) in zip(errors, panels, strict=True):
        _by_variant(axes, rows, value, style, parties, what)
    errors[0].set_yticks(range(len(variants)), wrapped, fontsize=SMALL)
    errors[0].set_ylim(len(variants) - 0.5, -0.5)
    return shown


def _by_parties(
    axes: Axes,
    rows: Sequence[Row],
    value: Value,
    style: Style,
    parties: list[int],
    title: str,
) -> None:
    """A column for each number of parties, in which each variant has its place."""
    drawn = [(row, y) for row in rows if (y := value(row)) is not None]
    # A panel is about 340 points wide.
    size = min(LARGEST_MARK, 0.8 * WIDTH * 340 / (len(parties) * len(style)))
    for row, y in drawn:
        colour, shape = style[row.protocol]
        x = parties.index(row.parties) + _place(list(style).index(row.protocol), len(style))
        axes.plot([x], [y], shape, color=colour, ms=size, mfc=_filling(colour, row.ideal))
    for i in range(1, len(parties)):
        axes.axvline(i - 0.5, color=GREY, lw=0.4)
    axes.set_xticks(range(len(parties)), [f"{count} parties" for count in parties], fontsize=SMALL)
    axes.tick_params(axis="x", length=0)
    axes.set_xlim(-0.5, len(parties) - 0.5)
    _scale(axes, "y", [y for _, y in drawn])
    _finish(axes, title, "y")


def _by_variant(
    axes: Axes,
    rows: Sequence[Row],
    value: Value,
    style: Style,
    parties: list[int],
    title: str,
) -> None:
    """A line for each variant, in which each number of parties has its height, and is named."""
    finite = [x for row in rows if (x := value(row)) and math.isfinite(x)]
    _scale(axes, "x", finite)
    left = axes.get_yaxis_transform()  # x in parts of the panel's width
    for row in rows:
        x, (colour, shape) = value(row), style[row.protocol]
        y = list(style).index(row.protocol) + _place(parties.index(row.parties), len(parties))
        named = f"P = {row.parties}"
        if x and math.isfinite(x):
            axes.plot([x], [y], shape, color=colour, ms=5, mfc=_filling(colour, row.ideal))
            axes.text(x, y, f"   {named}", fontsize=TINY, color=GREY, va="center")
        else:
            why = ("refused" if row.refused else "none") if x is None else "not a number" if x else "exact"
            axes.text(0.015, y, f"{named}: {why}", fontsize=TINY, color=GREY, va="center", transform=left)
    for i in range(1, len(style)):
        axes.axhline(i - 0.5, color=GREY, lw=0.4)
    axes.tick_params(axis="y", length=0)
    _finish(axes, title, "x")


def _place(i: int, count: int) -> float:
    """Where the i-th of so many stands, from -1/2 to 1/2."""
    return WIDTH * ((i + 0.5) / count - 0.5)


def _scale(axes: Axes, axis: Direction, values: list[float]) -> None:
    """Logarithmic, with room for all values; without numbers where there is none."""
    positive = [x for x in values if x]
    axes.set(**{f"{axis}scale": "log"})
    low, high = min(positive, default=1.0) / 2, max(positive, default=1.0) * 2.5
    axes.set(**{f"{axis}lim": (low, high)})
    ticks = axes.xaxis if axis == "x" else axes.yaxis
    ticks.set_major_locator(LogLocator(subs=(1, 2, 5) if high < 100 * low else (1,)))
    ticks.set_major_formatter(lambda value, _: f"{value:.3g}" if positive else "")
    ticks.set_minor_formatter(NullFormatter())
    axes.tick_params(axis=axis, labelsize=SMALL)


def _finish(axes: Axes, title: str, axis: Direction) -> None:
    axes.set_title(title, fontsize=10, loc="left")
    axes.grid(axis=axis, alpha=0.25)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)


def _filling(colour: str, ideal: bool) -> str:
    """Marks of what is no protocol are hollow."""
    return "white" if ideal else colour
