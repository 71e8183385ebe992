"""From episodes to counts, and from counts to the table beside the paper's."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from ciphernav_jax.navigation import paper
from ciphernav_jax.navigation.rollout import Episodes, Outcome
from ciphernav_jax.tables import Table
from ciphernav_jax.world.dataset import Dataset

Counts = dict[str, dict[str, int]]
"""For "detour" and "no_detour": trials, success, efficient, crash_obstacle, crash_wall, no_crash."""

HEADER = ("method", "detour", "no detour", "overall", "efficient", "obstacle / wall / lost")
NOTE = (
    "Accuracy in %, the paper's in brackets; overall from our counts. Efficient: % of the successes with at "
    "most as many actions as the shortest path. The last column counts failures: crashes with an obstacle, "
    "with a wall, and none; an episode ends at its first crash."
)
TITLES = {
    "random": "Random walk",
    "map-only": "Map only",
    "first-person": "First person",
    "first-person-deterministic": "First person, fixed start",
    "plaintext": "Plaintext, cameras",
    "plaintext-classifier": "Plaintext, the secret recipe",
    "plaintext-actions-alone": "Plaintext, from actions alone",
}


def tally(dataset: Dataset, episodes: Episodes, counted: NDArray[np.bool_] | None = None) -> Counts:
    """Counts by whether a detour was required; plain integers, fit for JSON.

    `counted`, bool[N], says which environments to count; None counts all.
    """
    success = episodes.outcome == Outcome.SUCCESS
    shortest = (np.asarray(dataset.actions) >= 0).sum(axis=1)
    efficient = success & (episodes.lengths <= shortest)
    detour = np.asarray(dataset.detour, bool)
    if counted is None:
        counted = np.ones_like(detour)
    return {
        half: {
            "trials": int(which.sum()),
            "success": int((success & which).sum()),
            "efficient": int((efficient & which).sum()),
            **{
                kind.name.lower(): int(((episodes.outcome == kind) & which).sum())
                for kind in Outcome
                if kind is not Outcome.SUCCESS
            },
        }
        for half, which in (("detour", counted & detour), ("no_detour", counted & ~detour))
    }


def overall(counts: Counts) -> dict[str, int]:
    """The two halves added up."""
    return {name: counts["detour"][name] + counts["no_detour"][name] for name in counts["detour"]}


def percent(part: int, whole: int) -> float:
    """100 * part / whole; not a number for nothing of nothing."""
    return 100 * part / whole if whole else float("nan")


def accuracy(counts: dict[str, int]) -> float:
    """Successes in percent of the trials."""
    return percent(counts["success"], counts["trials"])


def rows(results: Mapping[str, Counts]) -> list[tuple[str, ...]]:
    """The cells as text, in the order given; see `HEADER`. A name is a method's, or "METHOD, seed S"."""
    table = []
    for name, counts in results.items():
        method, *which = name.split(", ", 1)
        printed = paper.TABLE.get(method)
        both = overall(counts)
        cells = [
            (accuracy(counts["detour"]), printed and printed.detour),
            (accuracy(counts["no_detour"]), printed and printed.no_detour),
            (accuracy(both), printed and printed.overall),
            (percent(both["efficient"], both["success"]), printed and printed.efficient_overall),
        ]
        text = [f"{ours:.1f}" + (f" ({theirs:.1f})" if theirs is not None else "") for ours, theirs in cells]
        failures = " / ".join(str(both[kind]) for kind in ("crash_obstacle", "crash_wall", "no_crash"))
        table.append((", ".join([title(method), *which]), *text, failures))
    return table


def table(results: Mapping[str, Counts], heading: str = "") -> Table:
    """The table, with its note."""
    return Table(heading, HEADER, rows(results), NOTE)


def title(name: str) -> str:
    """The title of a row, by the name of its method; of a secret one by `secret-P`."""
    if name.startswith("secret-"):
        return f"{name.removeprefix('secret-')} parties, cameras"
    return TITLES.get(name, name)
