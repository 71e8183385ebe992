"""Tables of what secret training and decisions cost, beside the paper's."""

from ciphernav_jax.navigation import paper
from ciphernav_jax.tables import Cells, ms
from experiments.report.results import (
    Document,
    Results,
    overall_accuracy,
    seeds,
    spread,
    truncations,
)
from experiments.report.table import CHEAP, ROWS, Table, duration, made_by, script, title

BYTES = ("bytes_sent", "bytes_dealt")


def secret(results: Results) -> dict[str, list[Document]]:
    """The rows trained in secret, in the order of the tables."""
    order = [*CHEAP, *ROWS]
    names = [name for name, documents in results.runs.items() if "cost" in documents[0]]
    names.sort(key=lambda name: (order.index(name) if name in order else len(order), name))
    return {name: results.runs[name] for name in names}


def cost(results: Results) -> Table:
    """What secret trainings take: the headline."""
    rows = [_cost_row(name, documents) for name, documents in secret(results).items()]
    if rows:
        printed = (f"{paper.TABLE[name].overall:.1f}" for name in ("secret-2", "secret-5"))
        training = ("", _digits(paper.TRAINING_EPOCHS, 2), duration(paper.TRAINING_S), "", "", "", "")
        rows.append(("The paper, on a GPU", "", " / ".join(printed), *training))
    return Table(
        "What training in secret takes",
        (
            "training",
            "seeds",
            "accuracy",
            "steps",
            "epochs",
            "trained in",
            "compiled in",
            "ms a step",
            "messages: LAN",
            "messages: WAN",
        ),
        rows,
        "The classifier from scratch; all parties and the dealer on one machine. Epochs: passes over the "
        "training samples. Compiling is apart, and faster where JAX's cache has the program. Accuracy: "
        "overall, on the independent test set; the paper's with 2 / 5 parties. Messages: the time that those "
        "of all steps take on a network, projected; without computation, and without the dealer's.",
        name="cost",
        missing=made_by(results, CHEAP),
    )


def _cost_row(name: str, documents: list[Document]) -> Cells:
    steps = documents[0]["curve"][-1]["step"]
    trained = spread(documents, lambda document: document["seconds"]["train"]).mean
    projected = documents[0]["cost"]["training step"]["seconds"]
    return (
        title(name),
        seeds(documents),
        spread(documents, overall_accuracy).text(),
        f"{steps:,}",
        _digits(documents[0]["epochs"], 2),
        duration(trained),
        duration(spread(documents, lambda document: document["seconds"]["compile"]).mean),
        ms(trained / steps),
        *(duration(projected[network] * steps) for network in ("LAN", "WAN")),
    )


def messages(results: Results) -> Table:
    """Rounds and bytes of a training step and of a decision."""
    rows = []
    for name, documents in secret(results).items():
        step, decision = (documents[0]["cost"][what] for what in ("training step", "decision"))
        rows.append(
            (
                title(name),
                *(str(step["rounds"]), *(_digits(step[sent] / 1e6) for sent in BYTES)),
                *(str(decision["rounds"]), *(_digits(decision[sent] / 1e3) for sent in BYTES)),
                *(ms(decision["seconds"][network]) for network in ("LAN", "WAN")),
            )
        )
    of_step = tuple(f"step: {what}" for what in ("rounds", "MB sent", "MB dealt"))
    of_decision = tuple(f"decision: {what}" for what in ("rounds", "kB sent", "kB dealt", "LAN ms", "WAN ms"))
    return Table(
        "Messages of a training step, and of one robot's decision",
        ("training", *of_step, *of_decision),
        rows,
        "A step has momentum, and a rate that falls. *Sent*: by each party. *Dealt*: correlated randomness, "
        "to all parties together, before the step. Times are projected, without computation.",
        name="messages",
        missing=made_by(results, CHEAP),
    )


def _digits(number: float, count: int = 3) -> str:
    """With so many digits, and whole where it has more."""
    return f"{number:.{count}g}" if round(number) < 10**count else f"{number:,.0f}"


def audit(results: Results) -> Table:
    """Truncations of all secret trainings, and those that failed."""
    rows, sums = [], [0, 0, 0]
    for name, documents in secret(results).items():
        counted = truncations(documents)
        if counted[0]:
            rows.append((title(name), f"{len(documents)}", *(f"{count:,}" for count in counted)))
            sums = [a + b for a, b in zip(sums, (len(documents), *counted), strict=True)]
    if rows:
        rows.append(("All", *(f"{count:,}" for count in sums)))
    return Table(
        "Truncations carried out, and failed",
        ("training", "runs", "truncations", "failed"),
        rows,
        "Only a simulation, which knows every value, can count failures: results off by more than rounding.",
        name="truncations",
        missing=() if rows else made_by(results, CHEAP),
    )


def forward(results: Results) -> Table:
    """Times of a forward pass."""
    rows = [
        _forward_row(line, document["device"]["kind"])
        for document in results.others.get("forward", [])
        for line in document["results"]
    ]
    return Table(
        "A forward pass of the action classifier, batch 100",
        ("parties", "weights", "device", "ours: ms", "ours: quartiles", "paper: CPU ms", "paper: GPU ms"),
        rows,
        "Median after warm-up; all parties and the dealer on one machine. The paper has the weights public.",
        name="forward",
        missing=() if rows else (script("forward"),),
    )


def _forward_row(line: Document, device: str) -> Cells:
    times, printed = line["seconds"], paper.FORWARD.get(line["parties"])
    return (
        line["name"],
        line["weights"],
        device,
        ms(times["median"]),
        f"{ms(times['q1'])}-{ms(times['q3'])}",
        *((ms(printed.cpu), ms(printed.gpu)) if printed else ("", "")),
    )
