"""Tables of the engine's speed, beside other frameworks, and of variants."""

from ciphernav_jax import tables
from ciphernav_jax.comparison import Comparison
from ciphernav_jax.comparison.results import IDEAL
from experiments import bench
from experiments.report.results import Results
from experiments.report.table import Table, script


def benchmarks(results: Results) -> Table:
    """Of `python -m experiments bench`, our own works."""
    document = results.bench
    rows = bench.rows(document, document["titles"]) if document else []
    return Table(
        "Secret-shared work",
        bench.HEADER,
        rows,
        bench.NOTE,
        name="bench",
        missing=() if rows else ("python -m experiments bench",),
    )


def growth(results: Results) -> Table:
    """Of `python -m experiments bench`, how steps of training grow with the parties."""
    document = results.bench
    rows = bench.growth_rows(document, document["titles"]) if document else []
    missing = () if rows else ("python -m experiments bench --work train train-loop",)
    return Table(
        "Growth with the parties",
        bench.GROWTH_HEADER,
        rows,
        bench.GROWTH_NOTE,
        name="growth",
        missing=missing,
    )


def peers(results: Results) -> Table:
    """Of `python -m experiments bench --peers`, ours beside other frameworks."""
    document, header, rows = results.bench, (), []
    if document and document["peers"]:
        header, rows = bench.peers_rows(document, document["titles"])
    missing = () if rows else ("python -m experiments bench --peers",)
    return Table("Beside other frameworks", header, rows, bench.PEERS_NOTE, name="peers", missing=missing)


def short(results: Results) -> Table:
    """Of `peers`, the passes with secret weights; for the README."""
    whole, document = peers(results), results.bench
    names = {document["titles"].get(work) for work in ("forward", "train")} if document else set()
    rows = [row for row in whole.rows if row[0] in names]
    return Table(
        "Speed, in short",
        whole.header,
        rows,
        bench.PEERS_NOTE,
        name="short-speed",
        missing=() if rows else whole.missing,
    )


def variants(results: Results) -> Table:
    """Of `python -m experiments paper variants`, a step of training in each."""
    found = compared(results)
    shown = found.table() if found else tables.Table("", (), ())
    return Table(
        "Variants of the protocols: a training step",
        shown.header,
        shown.rows,
        " ".join([found.summary(), shown.note, *found.reasons()]) if found else "",
        name="variants",
        missing=() if found else (script("variants"),),
    )


def compared(results: Results) -> Comparison | None:
    """What `cn.compare` found."""
    documents = results.others.get("variants")
    return Comparison.from_dict(documents[0]["comparison"]) if documents else None


def trained(results: Results) -> Table:
    """Of the same, a training in each, and single truncations."""
    rows = [
        (
            of["protocol"] + IDEAL * of["ideal"],
            str(of["steps"]),
            f"{of['loss']:.4g}",
            f"{of['exact']:.4g}",
            f"{100 * (of['loss'] / of['exact'] - 1):+.2g} %",
            f"{of['value']:,.0f}",
            f"{of['truncations']:,}",
            f"{of['failed']:,}",
        )
        for document in results.others.get("variants", [])
        for of in document["trained"]
    ]
    return Table(
        "Variants of the protocols: a training, and single truncations",
        ("variant", "steps", "loss", "in float64", "off", "products of", "truncations", "failed"),
        rows,
        "With two parties. Loss: the squared error of the batch at the last step; it is one training, so "
        "small differences say nothing. Failed: of so many single truncations of products of this magnitude.",
        name="trained",
        missing=() if rows else (script("variants"),),
    )
