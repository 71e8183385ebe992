"""What one variant with one number of parties gave."""

import math
from dataclasses import asdict, dataclass
from typing import Any


@dataclass(frozen=True)
class Row:
    """One protocol with one number of parties. Where it was refused it has a reason, and no numbers.

    Attributes:
        protocol: as `str(Protocol)` writes it.
        parties: P.
        ideal: a trusted third party stands in for a protocol: what is counted is what is left beside it.
        refused: why there are no numbers; "" where there are.
        seconds: of a warm call, the median; all parties and the dealer on this machine.
        calls: how many were timed.
        compile_seconds: tracing and compiling, with nothing read from the persistent cache.
        rounds, bytes_sent, bytes_dealt: of `cn.cost`: messages that wait for one another; what each party
            sends; what the dealer sends to all.
        unbounded: they are for one iteration of a `while`, of nobody knows how many.
        lan_seconds, wan_seconds: projected for the messages alone; None where `ideal` or `unbounded`.
        error: the largest distance of a result from float64. Integers and bools count as numbers. Infinite
            where a result is NaN and float64's is not.
        error_units: the same in units of the last place, 2^-frac_bits.
        gradient_error, gradient_error_units: the same of the gradient of the sum of all float results by all
            secret float arguments.
        no_gradient: why there is none; "" where there is.
        truncations, failed: of one call, and how many of them landed farther off than any rounding.
        memory_bytes: of the compiled program: arguments, results and temporaries; None where XLA does not
            say.
    """

    protocol: str
    parties: int
    ideal: bool
    refused: str = ""
    seconds: float | None = None
    calls: int | None = None
    compile_seconds: float | None = None
    rounds: int | None = None
    bytes_sent: int | None = None
    bytes_dealt: int | None = None
    unbounded: bool | None = None
    lan_seconds: float | None = None
    wan_seconds: float | None = None
    error: float | None = None
    error_units: float | None = None
    gradient_error: float | None = None
    gradient_error_units: float | None = None
    no_gradient: str = ""
    truncations: int | None = None
    failed: int | None = None
    memory_bytes: int | None = None

    def as_dict(self) -> dict[str, Any]:
        """All of it for JSON, which has no infinity: that is the text "inf"."""
        return {
            name: str(x) if isinstance(x, float) and not math.isfinite(x) else x
            for name, x in asdict(self).items()
        }

    @staticmethod
    def from_dict(row: dict[str, Any]) -> "Row":
        """What `as_dict` gave."""
        fields: dict[str, Any] = {name: math.inf if x == "inf" else x for name, x in row.items()}
        return Row(**fields)
