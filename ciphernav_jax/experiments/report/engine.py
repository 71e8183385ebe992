"""Tables of the engine's speed, beside other frameworks, and of variants."""

from ciphernav_jax.experiments import bench, sweep
from ciphernav_jax.experiments.report.results import Results
from ciphernav_jax.experiments.report.table import Table


def benchmarks(results: Results) -> Table:
    """Of `ciphernav bench`, our own works."""
    document = results.bench
    rows = bench.rows(document, document["titles"]) if document else []
    return Table(
        "bench", "Secret-shared work", bench.HEADER, rows, bench.NOTE, () if rows else ("ciphernav bench",)
    )


def growth(results: Results) -> Table:
    """Of `ciphernav bench`, how steps of training grow with the parties."""
    document = results.bench
    rows = bench.growth_rows(document, document["titles"]) if document else []
    missing = () if rows else ("ciphernav bench --work train train-loop",)
    return Table("growth", "Growth with the parties", bench.GROWTH_HEADER, rows, bench.GROWTH_NOTE, missing)


def peers(results: Results) -> Table:
    """Of `ciphernav bench --peers`, ours beside other frameworks."""
    document, header, rows = results.bench, (), []
    if document and document["peers"]:
        header, rows = bench.peers_rows(document, document["titles"])
    missing = () if rows else ("ciphernav bench --peers",)
    return Table("peers", "Beside other frameworks", header, rows, bench.PEERS_NOTE, missing)


def variants(results: Results) -> Table:
    """Of `ciphernav sweep`."""
    rows = sweep.short_rows(results.sweep) if results.sweep else []
    missing = () if rows else ("ciphernav sweep",)
    return Table("sweep", "Variants of the protocols", sweep.SHORT_HEADER, rows, sweep.NOTE, missing)
