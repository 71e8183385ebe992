"""The picture of a sweep."""

from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator

from ciphernav_jax.comparison.pictures import COLOURS
from ciphernav_jax.files import write_png

# Colours are for the default and the extremes; the others are grey.
GREY = "#8C8C8C"
SMALL = 8

Points = dict[str, list[tuple[int, float]]]  # of each variant the numbers of parties, and a value for each


def sweep(document: dict[str, Any], path: Path) -> None:
    """Write `variants` of what `sweep.run` returns as a PNG."""
    save(variants(document), path)


def variants(document: dict[str, Any]) -> Figure:
    """Four panels: seconds of a step, and messages, by the parties; errors and the loss by variant."""
    done = [result for result in document["results"] if result["status"] == "done"]
    figure = Figure(figsize=(10, 8), layout="constrained")
    upper, lower = figure.subfigures(
        2, 1, squeeze=False
    ).flat  # rows of their own: the lower one has long names at its left
    (time, cost), (error, loss) = upper.subplots(1, 2), lower.subplots(1, 2, sharey=True)
    names = list(dict.fromkeys(result["protocol"] for result in done))
    series = {name: sorted((r for r in done if r["protocol"] == name), key=_parties) for name in names}
    seconds = _points(series, lambda r: r["step"]["seconds"]["median"])
    messages = _points(series, lambda r: r["step"]["cost"] and r["step"]["cost"]["wan_s"])
    colours = _colours(seconds, messages)
    _lines(time, series, seconds, colours)
    _title(time, "Training step, seconds")
    _lines(cost, series, messages, colours)
    _title(cost, "Training step, seconds of messages on a WAN (projected)")
    fewest = min(map(_parties, done))
    shown = sorted((r for r in done if r["parties"] == fewest), key=lambda r: r["outputs"]["largest"])
    _dots(error, shown, [r["outputs"]["largest"] for r in shown], colours)
    _title(error, f"Largest error of an output, P = {fewest}")
    _dots(loss, shown, [_off(r) for r in shown], colours)
    steps = document["configuration"]["effort"]["steps"]
    _title(loss, f"Loss after {steps} steps: relative error, P = {fewest}")
    return figure


def label(result: dict[str, Any]) -> str:
    """The variant in few words."""
    words = [word.partition("=") for word in result["protocol"].split(", ")]
    ideal = [name for name, _, value in words if value == "ideal"]
    others = [
        f"{name.removesuffix('_bits')} {value}" if name.endswith("_bits") else value or name
        for name, _, value in words
        if value != "ideal"
    ]
    if len(ideal) == 3:
        ideal = ["all"]
    said = f"{' and '.join(ideal)} ideal (not a protocol)"
    return ", ".join([*others, said] if ideal else others)


def _off(result: dict[str, Any]) -> float | None:
    if not result["curve"]:
        return None
    _, found, expected = result["curve"][-1]
    return abs(found / expected - 1)


def _points(series: dict[str, list[dict]], value: Any) -> Points:
    found = {
        name: [(r["parties"], value(r)) for r in results if value(r) is not None]
        for name, results in series.items()
    }
    return {name: points for name, points in found.items() if points}


def _colours(*panels: Points) -> dict[str, str]:
    """The same in all panels: for the default and, as far as they reach, each panel's extremes.

    Between these lines are too close to tell apart.
    """
    named = ["default"]
    for drawn in panels:
        last = max((points[-1][0] for points in drawn.values()), default=0)
        ends = sorted((n for n in drawn if drawn[n][-1][0] == last), key=lambda name: drawn[name][-1][1])
        named += [*reversed(ends[-3:]), *ends[:1]]
    return dict(zip(dict.fromkeys(named), COLOURS, strict=False))


def _lines(axes: Axes, series: dict[str, list[dict]], drawn: Points, colours: dict[str, str]) -> None:
    """A line for each variant; those that have a colour are named at its end."""
    if not drawn:  # ideal variants alone have no messages
        axes.set_axis_off()
        return
    for name, points in drawn.items():
        x, y = zip(*points, strict=True)
        colour, style = colours.get(name, GREY), "--" if series[name][0]["ideal"] else "-"
        front = name in colours
        axes.plot(x, y, style, color=colour, marker="o", ms=4 if front else 2.5, lw=1.8 if front else 0.8)
    ticks = sorted({x for points in drawn.values() for x, _ in points})
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xticks(ticks, [str(x) for x in ticks])
    axes.minorticks_off()
    axes.set_xlabel("parties")
    axes.set_xlim(right=ticks[-1] * 4)
    ends: dict[tuple[int, float], list[str]] = {}  # where lines coincide only the last drawn is seen
    for name in (n for n in drawn if n in colours):
        ends.setdefault(drawn[name][-1], []).append(name)
    _labels(
        axes,
        [
            (*end, " = ".join(label(series[name][0]) for name in names), colours[names[-1]])
            for end, names in ends.items()
        ],
    )
    _clean(axes)


def _labels(axes: Axes, ends: list[tuple[float, float, str, str]]) -> None:
    """Names beside the ends of their lines, pushed apart where they would overlap."""
    low, high = axes.get_ylim()
    gap, below = (high / low) ** 0.06, 0.0
    axes.set_ylim(low, high * gap**2)
    for x, y, text, colour in sorted(ends, key=lambda end: end[1]):
        below = max(y, below * gap)
        axes.text(x * 1.07, below, text, color=colour, fontsize=SMALL, va="center")


def _dots(axes: Axes, results: list[dict], values: list[float | None], colours: dict[str, str]) -> None:
    """A row for each variant, in its colour; empty where there is no value."""
    for row, (result, value) in enumerate(zip(results, values, strict=True)):
        if value:
            axes.scatter(value, row, color=colours.get(result["protocol"], GREY), s=28, zorder=3)
    axes.set_xscale("log")
    axes.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    axes.xaxis.set_major_formatter(lambda value, _: f"{value:.0e}".replace("e-0", "e-"))
    axes.minorticks_off()
    axes.tick_params(axis="x", labelsize=SMALL)
    axes.set_yticks(range(len(results)), [label(r) for r in results], fontsize=SMALL)
    _clean(axes)


def _title(axes: Axes, text: str) -> None:
    axes.set_title(text, fontsize=10, loc="left")


def _clean(axes: Axes) -> None:
    axes.grid(alpha=0.25)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)


def _parties(result: dict[str, Any]) -> int:
    return result["parties"]


def save(figure: Figure, path: Path) -> None:
    """Write a PNG, whole or not at all."""
    write_png(path, figure, dpi=90)
