"""All tables of the report."""

from collections.abc import Iterator

from experiments.report import attacks, costs, driving, engine, minutes
from experiments.report.results import Results
from experiments.report.table import SETS, Table


def every(results: Results) -> Iterator[Table]:
    """In their order."""
    for test_set in SETS:
        yield from (
            table(results, test_set) for table in (driving.accuracy, driving.failures, driving.efficiency)
        )
    others = (
        driving.bounds,
        driving.beyond,
        costs.cost,
        costs.messages,
        costs.audit,
        costs.forward,
        attacks.reconstruction,
        attacks.own_runs,
        attacks.queries,
        engine.benchmarks,
        engine.growth,
        engine.peers,
        engine.variants,
        minutes.minutes,
        engine.trained,
        driving.short,
        engine.short,
    )
    yield from (table(results) for table in others)
