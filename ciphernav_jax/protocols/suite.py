"""Which variant of each protocol is used."""

from dataclasses import dataclass
from typing import Literal, get_args

Truncation = Literal["probabilistic", "local"]


@dataclass(frozen=True)
class Protocol:
    """The choice of protocol variants; a value: frozen, hashable, compared by its fields.

    All variants are for semi-honest parties, up to P - 1 of which may collude, and a trusted dealer.

    Attributes:
        frac_bits: fractional bits f of secret values, 1 to 30. The resolution is 2^-f; values, and products
            before their truncation, must stay within +-2^(62 - 2 f). The default 20 gives a resolution of
            1e-6 and a range of 4 million: errors ten times below what 16 bits leave, and three orders of
            magnitude above the batch sums of the paper's classifier.
        truncation: "probabilistic" (unbiased, never fails in range, any number of parties) or "local" (no
            communication, two parties only, fails now and then; a baseline). See `protocols.truncate`.
    """

    frac_bits: int = 20
    truncation: Truncation = "probabilistic"

    def __post_init__(self):
        if not 1 <= self.frac_bits <= 30:
            raise ValueError(f"frac_bits must lie in 1..30, got {self.frac_bits}")
        if self.truncation not in get_args(Truncation):
            raise ValueError(
                f"unknown truncation {self.truncation!r}; the variants are {', '.join(get_args(Truncation))}"
            )

    @property
    def bound(self) -> float:
        """2^(62 - 2 f): values and products must stay below it in magnitude."""
        return 2.0 ** (62 - 2 * self.frac_bits)
