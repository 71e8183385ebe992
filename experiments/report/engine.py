"""Tables of the engine's speed, beside other frameworks, and of variants."""

from experiments import bench, sweep
from experiments.report.results import Results
from experiments.report.table import Table


def benchmarks(results: Results) -> Table:
    """Of `python -m experiments bench`, our own works."""
    document = results.bench
    rows = bench.rows(document, document["titles"]) if document else []
    return Table(
        "bench",
        "Secret-shared work",
        bench.HEADER,
        rows,
        bench.NOTE,
        () if rows else ("python -m experiments bench",),
    )


def growth(results: Results) -> Table:
    """Of `python -m experiments bench`, how steps of training grow with the parties."""
    document = results.bench
    rows = bench.growth_rows(document, document["titles"]) if document else []
    missing = () if rows else ("python -m experiments bench --work train train-loop",)
    return Table("growth", "Growth with the parties", bench.GROWTH_HEADER, rows, bench.GROWTH_NOTE, missing)


def peers(results: Results) -> Table:
    """Of `python -m experiments bench --peers`, ours beside other frameworks."""
    document, header, rows = results.bench, (), []
    if document and document["peers"]:
        header, rows = bench.peers_rows(document, document["titles"])
    missing = () if rows else ("python -m experiments bench --peers",)
    return Table("peers", "Beside other frameworks", header, rows, bench.PEERS_NOTE, missing)


def short(results: Results) -> Table:
    """Of `peers`, the passes with secret weights; for the README."""
    whole, document = peers(results), results.bench
    names = {document["titles"].get(work) for work in ("forward", "train")} if document else set()
    rows = [row for row in whole.rows if row[0] in names]
    return Table(
        "short-speed", "Speed, in short", whole.header, rows, bench.PEERS_NOTE, () if rows else whole.missing
    )


def variants(results: Results) -> Table:
    """Of `python -m experiments sweep`."""
    rows = sweep.short_rows(results.sweep) if results.sweep else []
    missing = () if rows else ("python -m experiments sweep",)
    return Table("sweep", "Variants of the protocols", sweep.SHORT_HEADER, rows, sweep.NOTE, missing)
