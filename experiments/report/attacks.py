"""Tables of attacks."""

from collections.abc import Callable

from ciphernav_jax.navigation import paper
from experiments.paper import exact
from experiments.paper.attack import ATTACKERS
from experiments.report.results import Document, Results, spread
from experiments.report.table import OVER_SEEDS, Table, script


def reconstruction(results: Results) -> Table:
    """How well attackers tell whether there is an obstacle in a camera's view."""
    documents = results.others.get("reconstruction", [])
    features, shares = (paper.RECONSTRUCTION[what] for what in ("features", "shares"))
    # The paper's encoders, too, learn from actions alone.
    printed = {"features": features, "features, actions alone": features, "share": shares}
    seen = documents[0]["results"] if documents else {}
    attackers = [name for name in next(iter(seen.values()), ()) if name not in ("words", "train")]
    rows = []
    for what in seen:
        found = [document["results"][what] for document in documents]
        trials = sum(result[attackers[0]]["all"]["trials"] for result in found)
        rows.append(
            (
                what.capitalize(),
                f"{found[0]['words']:,}",
                f"{trials:,}",
                str(printed.get(what, "")),
                *(_score([result[attacker]["all"] for result in found]) for attacker in attackers),
            )
        )
    return Table(
        "Is there an obstacle in a camera's view? Right answers in percent",
        ("what the attacker sees", "words", "trials", "paper", *(f"ours: {name}" for name in attackers)),
        rows,
        f"Chance is {paper.RECONSTRUCTION['chance']:g}. {OVER_SEEDS}; of one seed, the 95 % interval. "
        "Plaintext features, reused masks, no mask and no own share are leaks put there so that they be "
        "found.",
        name="reconstruction",
        missing=() if rows else (script("reconstruction"),),
    )


def _score(scores: list[Document]) -> str:
    if len(scores) == 1:
        low, high = scores[0]["interval"]
        return f"{scores[0]['accuracy']:.1f} ({low:.1f}-{high:.1f})"
    return spread(scores, lambda score: score["accuracy"]).text(1)


def own_runs(results: Results) -> Table:
    """What coalitions find in a training and the drives of both test sets together."""
    documents = results.others.get("own_runs", [])
    rows = []
    for coalition in documents[0]["results"] if documents else ():
        found = [document["results"][coalition] for document in documents]
        sights = [sight for of_seed in found for sight in of_seed["exact"].values()]
        pairs = [pair for of_seed in found for pair in of_seed["learned"].values()]
        rows.append(
            (
                coalition.capitalize(),
                *(f"{sum(sight[what] for sight in sights):,}" for what in exact.FOUND),
                *(_together([s for pair in pairs for s in pair[name].values()]) for name in ATTACKERS),
            )
        )
    return Table(
        "What all parties but one find in the project's own runs, with the keys that these derive",
        ("who", *exact.FOUND, *(f"learned: {name}" for name in ATTACKERS)),
        rows,
        "One training and the drives of both test sets, looked at together. *Words*: numbers that are seen. "
        "*Read*: hidden values that are the sum or the difference of two of them; *compared*: whose sum with "
        "another hidden value, or whose difference to it, is; *repeated*: words seen twice, or negated. "
        "Learned: obstacles in a camera's view, right answers in percent of all guesses, where chance is 50; "
        "in brackets the worst and the best of all cameras and pairs of runs.",
        name="own_runs",
        missing=() if rows else (script("own_runs"),),
    )


def _together(scores: list[Document]) -> str:
    accuracies = [score["accuracy"] for score in scores]
    hits, trials = (sum(score[what] for score in scores) for what in ("hits", "trials"))
    return f"{100 * hits / trials:.1f} ({min(accuracies):.1f}-{max(accuracies):.1f})"


def queries(results: Results) -> Table:
    """What all answers together tell about obstacles."""
    documents = results.others.get("queries", [])
    obstacles = documents[0]["results"]["obstacles"] if documents else {}

    def cell(value: Callable[[Document], float]) -> str:
        return spread(documents, lambda document: value(document["results"])).text(1)

    rows = [
        (
            known.capitalize(),
            *(
                cell(lambda found, k=known, m=measure: _best(found["obstacles"][k], m))
                for measure in ("balanced", "auc", "exact")
            ),
            *(
                cell(lambda found, k=known, p=prop: _best(found[p][k]))
                if known in documents[0]["results"][prop]
                else ""
                for prop in ("shape", "colour")
            ),
        )
        for known in obstacles
    ]
    if rows:
        usual = (
            cell(lambda found, p=prop: found[p]["most frequent"]["accuracy"]) for prop in ("shape", "colour")
        )
        rows.append(("Always the most frequent", "", "", "", *usual))
    return Table(
        "What a robot infers that asks for the way to every goal",
        ("what it knows", "obstacles: balanced", "obstacles: AUC", "obstacles: all", "shape", "colour"),
        rows,
        f"In percent, of the better attacker. {OVER_SEEDS}. Obstacles: balanced accuracy over the cells "
        "that may hold one, area under the curve, and how often all cells are right. Shape and colour are "
        "those of an only obstacle. *Layout* is what is known beforehand, *camera features* what a leak "
        "would tell. The paper has no number: it argues that answers tell where obstacles are, and no more.",
        name="queries",
        missing=() if rows else (script("queries"),),
    )


def _best(attackers: Document, measure: str = "accuracy") -> float:
    """The number of the attacker that does best."""
    values = [found[measure] for found in attackers.values()]
    return max(value["accuracy"] if isinstance(value, dict) else value for value in values)
