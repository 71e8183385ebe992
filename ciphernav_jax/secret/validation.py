"""Where a function on secrets loses range or resolution, line by line."""

import io
from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from typing import Any

import jax
import numpy as np
from jax import Array
from rich.console import Console, Group
from rich.table import Table

from ciphernav_jax.jax_private import Tracer
from ciphernav_jax.protocols.truncate import VARIANTS
from ciphernav_jax.secret.arguments import Arguments
from ciphernav_jax.secret.compiled import Compiled
from ciphernav_jax.secret.findings import Findings
from ciphernav_jax.secret.places import Place
from ciphernav_jax.secret.secured import Secure, require_step
from ciphernav_jax.secret.witness import LOST, RANGE_BITS, Notes, Site, Witness


class ValidationError(ArithmeticError):
    """A function on secrets lost range or resolution; the message names the first line where it did.

    Attributes:
        report: the whole `Report`.
    """

    def __init__(self, report: "Report"):
        super().__init__(report.summary())
        self.report = report


@dataclass(frozen=True)
class Row:
    """What one primitive did on one line of the function; equations and iterations together.

    Attributes:
        place: the line, with its file and function; of an argument its name.
        primitive: JAX's name of the operation; "argument" for a secret argument.
        values: entries that it computed.
        magnitude: the largest, by itself or by its reference, as a share of the bound that it must not reach.
        error: the largest distance from the reference in units of the last place.
        faint: how many entries fell below the resolution: not 0 in the reference, and smaller than a unit.
        faint_share: their part of the sum of all entries' magnitudes.
        truncations, failed: of its results, and how many of them landed farther off than any rounding.
        differing: bits and integers that are not those of the reference.
        wrong: comparisons, maxima and the like that are wrong for the secrets they were given.
        not_numbers: entries whose reference is NaN; of an argument, those that were no numbers in range when
            they were shared.
    """

    place: Place
    primitive: str
    values: int = 0
    magnitude: float = 0.0
    error: float = 0.0
    faint: int = 0
    faint_share: float = 0.0
    truncations: int = 0
    failed: int = 0
    differing: int = 0
    wrong: int = 0
    not_numbers: int = 0

    @property
    def lost(self) -> str:
        """What was lost here: "range", "resolution", or "" for neither."""
        if any(getattr(self, name) > most for name, most in LOST.items()):
            return "range"
        return "resolution" if self.faint_share > 0.5 else ""


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Report:
    """What `validate` found; a pytree of numbers, printed as a table.

    Under `jax.lax.scan` and `jax.vmap` its arrays have further leading axes; what it says is then of all runs
    together: largest values, and sums of counts.

    Attributes:
        frac_bits: f; a unit of the last place is 2^-f.
        notes: the numbers (`secret.witness`).
    """

    frac_bits: int = field(metadata={"static": True})
    notes: Notes

    def merged(self, other: "Report") -> "Report":
        """Of this run and another one of the same step: for a loop in Python, or a carry of `lax.scan`."""
        return Report(self.frac_bits, self.notes.merged(other.notes))

    @cached_property
    def equations(self) -> tuple[Row, ...]:
        """A row for each equation, in the program's order."""
        return self._rows([[i] for i in range(len(self.notes.sites))])

    @cached_property
    def rows(self) -> tuple[Row, ...]:
        """A row for each line and primitive, those of its equations together."""
        found: dict[Site, list[int]] = {}
        for i, site in enumerate(self.notes.sites):
            found.setdefault(site, []).append(i)
        return tuple(row for row in self._rows(list(found.values())) if row.values or row.truncations)

    @property
    def range_lost(self) -> Row | None:
        """The equation that lost range before all others, in the first iteration where one did, with its
        magnitude of then; None where none did. What follows may be a consequence.
        """
        number, magnitude = self._over_runs.first
        return replace(self.equations[number - 1], magnitude=float(magnitude)) if number else None

    @property
    def resolution_lost(self) -> Row | None:
        """The first equation in the program that lost resolution, None where none did: over all iterations
        more than half of what it computed, in sum of magnitudes, is smaller than a unit.
        """
        return next((row for row in self.equations if row.lost == "resolution"), None)

    @property
    def first(self) -> Row | None:
        """The one that lost range; where none did, the one that lost resolution."""
        return self.range_lost or self.resolution_lost

    def check(self) -> None:
        """Raises ValidationError where range or resolution is lost."""
        if self.first:
            raise ValidationError(self)

    def _rows(self, groups: list[list[int]]) -> tuple[Row, ...]:
        notes = self._over_runs

        def row(group: list[int]) -> Row:
            site = notes.sites[group[0]]
            largest = {name: float(np.max(x[group])) for name, x in notes.largest.items()}
            total = {name: np.sum(x[group]) for name, x in notes.total.items()}
            signal, faint_signal = total.pop("signal"), total.pop("faint_signal")
            counts = {name: int(x) for name, x in total.items()}
            share = float(faint_signal / signal) if signal else 0.0
            return Row(site.place, site.primitive, faint_share=share, **largest, **counts)

        return tuple(map(row, groups))

    @cached_property
    def _over_runs(self) -> Notes:
        if any(isinstance(x, Tracer) for x in jax.tree.leaves(self.notes)):
            raise TypeError(
                "a report has no numbers under jax.jit, jax.lax.scan or jax.vmap. "
                "Return it from there, and look at it outside."
            )
        return jax.tree.map(np.asarray, self.notes.over_runs())

    # --- to read ---

    def as_dict(self) -> dict[str, Any]:
        """All of it in numbers and strings, for JSON."""
        return {
            "frac_bits": self.frac_bits,
            "range_lost": self.range_lost and asdict(self.range_lost),
            "resolution_lost": self.resolution_lost and asdict(self.resolution_lost),
            "rows": [asdict(row) for row in self.rows],
        }

    def summary(self) -> str:
        """Where range and resolution are lost first, and what helps."""
        found = [(self.range_lost, _range_lost), (self.resolution_lost, _resolution_lost)]
        lost = [tell(self, row) for row, tell in found if row]
        return "\n".join(lost) or "Neither range nor resolution is lost."

    def table(self) -> Table:
        """A row for each line and primitive."""
        table = Table()
        table.add_column("line", overflow="fold")
        table.add_column("operation", overflow="fold")
        for name in ("entries", "range", "error", "faint", "truncated", "failed", "differ", "wrong"):
            table.add_column(name, justify="right")
        for row in self.rows:
            table.add_row(
                row.place.short,
                row.primitive,
                f"{row.values:,}",
                _percent(row.magnitude),
                f"{row.error:,.3g}" if row.error else "",
                _percent(row.faint / row.values) if row.faint else "",
                *(f"{n:,}" if n else "" for n in (row.truncations, row.failed, row.differing, row.wrong)),
                style={"range": "bold red", "resolution": "yellow", "": ""}[row.lost],
            )
        return table

    def __rich__(self) -> Group:
        return Group(self.summary(), self.table())

    def __str__(self) -> str:
        text = io.StringIO()
        Console(file=text, width=120).print(self)
        return "\n".join(line.rstrip() for line in text.getvalue().rstrip().splitlines())


def validate(step: Secure, *, strict: bool = False) -> Callable[..., tuple[Any, Report]]:
    """The function with a report of where it loses range or resolution. **A privilege of the simulation**:
    no party can tell.

    The parties' program runs as ever. Beside it the same function is evaluated in float64 on what the secrets
    hold, and every operation is compared with it, in loops and branches as well. An error is that of the
    whole computation so far, not that of one operation alone. Public decisions, the number of iterations and
    the branch taken, are those of the program.

    Args:
        step: made by `secure`.
        strict: raise where range or resolution is lost. Not under `jax.jit`, `jax.lax.scan` or `jax.vmap`:
            there return the report, and call its `check()` outside.

    Returns:
        `validated(key, *args) -> (result, report)`: the result of `step(key, *args)` bit for bit, and a
        `Report`: `print` it, or take `report.rows`, `report.first`, `report.as_dict()`. Jitted; works under
        `jax.jit`, `jax.lax.scan` and `jax.vmap`, where the report is a pytree. A call takes about twice as
        long as that of `step`.

        Range is lost where a value reaches 2^(62 - 2 frac_bits) when it is shared, or in a product before
        its truncation; or 2^(62 - frac_bits) elsewhere; where a truncation fails or a comparison is wrong;
        and where something was shared that is no number in range. Resolution is lost where more than half of
        what an operation computes, in sum of magnitudes, is smaller than 2^-frac_bits.

    Raises:
        TypeError: `step` was not made by `secure`.
        What `step` would raise (when called).
        ValidationError (when called, `strict`): range or resolution is lost; the message names the line.

    Example:
        >>> import jax, jax.numpy as jnp, numpy as np
        >>> import ciphernav_jax as cn
        >>> x = cn.share(jax.random.key(0), np.array([3000.0, 2.0]), parties=2)
        >>> step = cn.secure(lambda x: jnp.sum(x * x))
        >>> result, report = cn.validate(step)(jax.random.key(1), x)
        >>> report.first.lost
        'range'
    """
    require_step(step)

    @Compiled
    def evaluate(key: Array, given: Arguments) -> tuple[Any, Report, Findings]:
        result, (notes, findings) = step.witnessed(key, given, Witness(step.protocol, beside=True))
        assert notes is not None
        return result, Report(step.protocol.frac_bits, notes), findings

    def validated(key: Array, *args: Any, **kwargs: Any) -> tuple[Any, Report]:
        result, report, findings = evaluate(key, step.checked(key, *args, **kwargs))
        step.require_sound(key, findings)
        if strict:
            report.check()
        return result, report

    return validated


# --- in words -----------------------------------------------------------------------------------------


def _range_lost(report: Report, row: Row) -> str:
    at = f"Range is lost first at {row.place}, in `{row.primitive}`: "
    if row.not_numbers:
        return (
            f"{at}{row.not_numbers:,} of {row.values:,} entries are no numbers in range. "
            "Look for NaN, infinity and values beyond the range where they are shared, or public in the step "
            "that made them."
        )
    if row.magnitude > 1:
        bound = 2.0 ** (RANGE_BITS - 2 * report.frac_bits)
        return (
            f"{at}the largest value is {_percent(row.magnitude)} of what fits. What is shared, and a "
            f"product, stays below {bound:,.0f} in magnitude. Scale the inputs down, or take fewer "
            "fractional bits."
        )
    if row.failed:
        may_fail = [name for name, variant in VARIANTS.items() if variant.fails]
        return (
            f"{at}{row.failed:,} of {row.truncations:,} truncations failed. What was truncated is out of "
            f"range, or the truncation may fail in range too, as {', '.join(may_fail)} may."
        )
    return (
        f"{at}{row.wrong:,} of {row.values:,} comparisons are wrong. "
        "Are the values within 2^range_bits? Take a larger range_bits, or None for the whole range."
    )


def _resolution_lost(report: Report, row: Row) -> str:
    return (
        f"Resolution is lost first at {row.place}, in `{row.primitive}`: {row.faint:,} of {row.values:,} "
        f"entries are smaller than a unit of the last place, 2^-{report.frac_bits}. Sum a loss instead of "
        "averaging it, multiply factors with one another before they meet a secret, or take more fractional "
        "bits."
    )


def _percent(share: float) -> str:
    percent = 100 * share
    if percent >= 10:
        return f"{percent:,.0f} %" if percent < 1e9 else f"{percent:.0e} %"
    return f"{percent:.2g} %" if percent >= 0.1 else f"{percent:.0g} %" if percent else ""
