"""Tables of how robots drive, beside the paper's."""

from collections.abc import Callable, Iterator, Mapping

from ciphernav_jax.navigation import metrics, paper
from ciphernav_jax.tables import Cells
from experiments.report.results import Document, Results, overall_accuracy, seeds, spread
from experiments.report.table import (
    BEYOND,
    OVER_SEEDS,
    RECIPES,
    ROWS,
    SETS,
    SHORT,
    Table,
    made_by,
    script,
    title,
)

HALVES = ("detour", "no_detour", "overall")
ABOUT = {
    "test": "An episode ends at its first invalid move as a crash, which is stricter than the authors' "
    "release. With more than five parties the additional ones hold no view; they hold shares, and take part "
    "in all that is computed.",
    "unseen": "No environment has both its walls and its obstacle cells in common with one in training; the "
    "paper has no such set.",
}
ABOUT_RECIPES = (
    " The paper's recipe: SGD with a learning rate of 0.01 on the squared loss, its batch read in two ways, "
    "600 epochs; in secret with 500 samples a step (`experiments.paper.paper_recipe`)."
)


def accuracy(results: Results, test_set: str) -> Table:
    """Successes in percent of the trials."""
    printed = {(name, half): getattr(row, half) for name, row in paper.TABLE.items() for half in HALVES}
    return Table(
        f"Accuracy in percent, {SETS[test_set]}",
        *_beside(results, test_set, _share("success", "trials"), printed),
        f"{OVER_SEEDS}; *overall* from the counts. {ABOUT[test_set]}"
        + ABOUT_RECIPES * bool(_recipes(results)),
        name=f"accuracy-{test_set}",
        missing=made_by(results, ROWS),
    )


def short(results: Results) -> Table:
    """Of `accuracy`, a few rows and both halves together, in both sets; for the README."""
    rows = [
        (
            title(name),
            f"{paper.TABLE[name].overall:.1f}",
            *(spread(documents, lambda d, s=s: overall_accuracy(d, s)).text() for s in SETS),
        )
        for name in SHORT
        if (documents := results.runs.get(name))
    ]
    return Table(
        "Accuracy in percent, in short",
        ("method", "the paper", "ours", "ours, unseen layouts"),
        rows,
        f"{OVER_SEEDS}, in percent of all episodes.",
        name="short-accuracy",
        missing=made_by(results, SHORT),
    )


def efficiency(results: Results, test_set: str) -> Table:
    """Successes that are as short as possible, in percent of the successes."""
    printed = {
        (name, half): getattr(row, f"efficient_{half}")
        for name, row in paper.TABLE.items()
        for half in HALVES
    }
    return Table(
        f"Efficient successes in percent, {SETS[test_set]}",
        *_beside(results, test_set, _share("efficient", "success"), printed),
        f"{OVER_SEEDS}: successes with at most as many actions as the shortest path, of all successes.",
        name=f"efficiency-{test_set}",
        missing=made_by(results, ROWS),
    )


def beyond(results: Results) -> Table:
    """What longer trainings reach, with robots that use what they alone know or without; and those alone."""
    header, rows = ["method", "seeds"], []
    for words in SETS.values():
        header += [f"{words}: {column}" for column in ("accuracy", "efficient", "lost", "alone")]
    for name in BEYOND:
        if documents := results.runs.get(name):
            cells = (cell for test_set in SETS for cell in _careful_cells(documents, test_set))
            rows.append((title(name), seeds(documents), *cells))
    return Table(
        "Past the paper: longer trainings, and robots that use what they alone know",
        tuple(header),
        rows,
        f"{OVER_SEEDS}. A careful robot uses its map, where it has been, and what it sees straight ahead "
        "with a network of its own; from the first answer that makes no sense to it on, it plans for itself. "
        "Accuracy and efficient successes in percent. Lost: episodes of all seeds that end without a crash "
        "away from the goal. Alone: robots that came to plan for themselves, in percent "
        "(`experiments.paper.beyond`).",
        name="beyond",
        missing=made_by(results, BEYOND),
    )


def _careful_cells(documents: list[Document], test_set: str) -> Iterator[str]:
    def mean(value: Callable[[Document], float]) -> str:
        return spread(documents, value).text(2)

    def counts(document: Document) -> metrics.Counts:
        return document["results"][test_set]["counts"]

    yield mean(lambda d: _share("success", "trials")(counts(d), "overall"))
    yield mean(lambda d: _share("efficient", "success")(counts(d), "overall"))
    yield str(sum(metrics.overall(counts(d))["no_crash"] for d in documents))
    careful = "alone" in documents[0]["results"][test_set]
    trials = metrics.overall(counts(documents[0]))["trials"]
    yield mean(lambda d: metrics.percent(d["results"][test_set]["alone"], trials)) if careful else ""


def failures(results: Results, test_set: str) -> Table:
    """How failed episodes ended, scaled to the paper's number of trials."""

    def value(counts: metrics.Counts, kind: str) -> float:
        both = metrics.overall(counts)
        return both[kind] * paper.TRIALS / both["trials"]

    names, kinds = tuple(paper.FAILURES), paper.Failures._fields
    printed = {(name, kind): getattr(row, kind) for name, row in paper.FAILURES.items() for kind in kinds}
    return Table(
        f"Failures of {paper.TRIALS:,} episodes, {SETS[test_set]}",
        *_beside(results, test_set, value, printed, kinds, names, digits=1),
        f"{OVER_SEEDS}, counted in each seed's test and scaled to the paper's {paper.TRIALS:,} episodes, "
        "half of which require a detour. Obstacle and wall: crashes. No crash: the robot stops elsewhere "
        "than on its goal, or wanders.",
        name=f"failures-{test_set}",
        missing=made_by(results, names),
    )


def bounds(results: Results) -> Table:
    """The best plan by what is known at the start."""
    documents = results.others.get("bounds", [])
    rows = [
        (
            known.capitalize(),
            *(f"{sets['test'][half]:.1f}" for half in HALVES),
            f"{sets['unseen']['overall']:.1f}",
        )
        for document in documents
        for known, sets in document["results"].items()
    ]
    return Table(
        "The best plan that can be made at the start",
        ("known at the start", "detour", "no detour", "overall", "unseen: overall"),
        rows,
        "Accuracy in percent, exact over all scenarios as the independent test set draws them, and as the "
        "unseen one does: there, who knows what has come up in training can rule it out. A model that "
        "knows the map alone cannot be better than the first row without a leak; one with eyes sees more "
        "as it goes.",
        name="bounds",
        missing=() if rows else (script("bounds"),),
    )


def _recipes(results: Results) -> list[str]:
    """The rows that follow `ROWS`."""
    return sorted(name for name in results.runs if name.startswith(RECIPES))


def _share(part: str, whole: str) -> Callable[[metrics.Counts, str], float]:
    """In percent, of one half of the counts or of both together."""

    def value(counts: metrics.Counts, half: str) -> float:
        counted = metrics.overall(counts) if half == "overall" else counts[half]
        return metrics.percent(counted[part], counted[whole])

    return value


def _beside(
    results: Results,
    test_set: str,
    value: Callable[[metrics.Counts, str], float],
    printed: Mapping[tuple[str, str], float],
    columns: tuple[str, ...] = HALVES,
    names: tuple[str, ...] = ROWS,
    digits: int = 2,
) -> tuple[Cells, list[Cells]]:
    """Header and rows: for each column ours, and in the set that the paper has, its number before."""
    theirs = printed if test_set == "test" else {}
    header, rows = ["method", "seeds"], []
    for column in columns:
        word = column.removeprefix("crash_").replace("_", " ")
        header += [f"{word}: paper", f"{word}: ours"] if theirs else [word]
    for name in [*names, *(_recipes(results) if names == ROWS else ())]:
        if documents := results.runs.get(name):
            cells = []
            for column in columns:
                ours = spread(documents, lambda d, c=column: value(d["results"][test_set]["counts"], c))
                number = theirs.get((name, column))
                cells += [*(["" if number is None else str(number)] if theirs else []), ours.text(digits)]
            rows.append((title(name), seeds(documents), *cells))
    return tuple(header), rows
