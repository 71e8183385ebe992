"""The picture of a sweep."""

import os
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

# Okabe and Ito's colours, for the default and three variants that differ most; the others are grey.
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00")
GREY = "#8C8C8C"
SMALL = 8


def sweep(document: dict[str, Any], path: Path) -> None:
    """Four panels: seconds of a step, and messages, by the number of parties; errors and the loss by variant.

    Args:
        document: what `sweep.run` returns.
        path: the PNG to write.
    """
    done = [result for result in document["results"] if result["status"] == "done"]
    figure = Figure(figsize=(11, 9), layout="constrained")
    (time, cost), (error, loss) = figure.subplots(2, 2)
    names = list(dict.fromkeys(result["protocol"] for result in done))
    series = {name: sorted((r for r in done if r["protocol"] == name), key=_parties) for name in names}
    # The coloured ones: the default, and those whose time is farthest from it.
    _lines(time, series, lambda r: r["step"]["seconds"]["median"])
    time.set(title="Training step, seconds (all parties on one machine)", yscale="log")
    _lines(cost, series, lambda r: r["step"]["cost"] and r["step"]["cost"]["wan_s"])
    cost.set(title="Training step on a WAN, projected seconds (messages alone)", yscale="log")
    fewest = min(map(_parties, done))
    shown = [r for r in done if r["parties"] == fewest]
    _bars(error, shown, lambda r: r["outputs"]["largest"])
    error.set(title=f"Largest error of an output, P = {fewest}", xscale="log")
    _bars(loss, [r for r in shown if r["curve"]], lambda r: abs(r["curve"][-1][1] / r["curve"][-1][2] - 1))
    steps = document["configuration"]["effort"]["steps"]
    loss.set(title=f"Loss after {steps} steps: relative error, P = {fewest}", xscale="log")
    _save(figure, path)


def label(result: dict[str, Any]) -> str:
    """The variant in few words."""
    text = result["protocol"].replace("frac_bits=", "f=").replace("range_bits=", "range=")
    for word in ("multiplication=", "truncation=", "comparison=", "adder=", "generator="):
        text = text.replace(word, "" if "ideal" not in text else word[:5].rstrip("=") + ". ")
    return f"{text} (not a protocol)" if result["ideal"] else text


def _lines(axes: Axes, series: dict[str, list[dict]], value: Any) -> None:
    drawn = {}
    for name, results in series.items():
        points = [(r["parties"], value(r)) for r in results if value(r) is not None]
        if points:
            drawn[name] = points
    ends = sorted(drawn, key=lambda name: drawn[name][-1][1])
    # Direct labels for the default and the extremes; between them lines are too close to tell apart.
    named = dict.fromkeys(["default", *reversed(ends[-3:]), *ends[:1]])
    colours = dict(zip((n for n in named if n in drawn), COLOURS, strict=False))
    for name, points in drawn.items():
        x, y = zip(*points, strict=True)
        colour, style = colours.get(name, GREY), "--" if series[name][0]["ideal"] else "-"
        front = name in colours
        axes.plot(x, y, style, color=colour, marker="o", ms=4 if front else 2.5, lw=1.8 if front else 0.8)
    last = max(points[-1][0] for points in drawn.values())
    ticks = sorted({x for points in drawn.values() for x, _ in points})
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xticks(ticks, [str(x) for x in ticks])
    axes.minorticks_off()
    axes.set_xlabel("parties")
    axes.set_xlim(right=last * 2.6)
    _labels(axes, [(*drawn[name][-1], label(series[name][0]), colour) for name, colour in colours.items()])
    _clean(axes)


def _labels(axes: Axes, ends: list[tuple[float, float, str, str]]) -> None:
    """Names beside the ends of their lines, pushed apart where they would overlap."""
    low, high = axes.get_ylim()
    gap, below = (high / low) ** 0.05, 0.0
    for x, y, text, colour in sorted(ends, key=lambda end: end[1]):
        below = max(y, below * gap)
        axes.text(x * 1.07, below, text, color=colour, fontsize=SMALL, va="center")


def _bars(axes: Axes, results: list[dict], value: Any) -> None:
    results = sorted(results, key=value)
    values = [value(r) for r in results]
    default = [r["protocol"] == "default" for r in results]
    colours = [COLOURS[0] if d else GREY for d in default]
    axes.scatter(values, range(len(values)), c=colours, s=28, zorder=3)
    axes.set_yticks(range(len(values)), [label(r) for r in results], fontsize=SMALL)
    _clean(axes)


def _clean(axes: Axes) -> None:
    axes.grid(alpha=0.25)
    axes.title.set_fontsize(10)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)


def _parties(result: dict[str, Any]) -> int:
    return result["parties"]


def _save(figure: Figure, path: Path) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    aside = path.with_name(path.name + ".part")
    figure.savefig(aside, format="png", dpi=110)
    os.replace(aside, path)
