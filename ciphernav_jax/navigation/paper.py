"""The numbers printed in the paper (Lu, Chiquier, Vondrick, NeurIPS 2022), in percent.

Its *overall* is not always the mean of its halves; ours is derived from the counts.
"""

from typing import NamedTuple


class Row(NamedTuple):
    """Accuracy (success) and efficiency (share of successes at most as long as the label)."""

    detour: float
    no_detour: float
    overall: float
    efficient_detour: float
    efficient_no_detour: float
    efficient_overall: float


TABLE = {
    "random": Row(6.2, 53.1, 29.9, 7.2, 38.8, 37.8),
    "map-only": Row(64.3, 77.5, 74.0, 100.0, 93.2, 95.5),
    "first-person": Row(64.5, 79.7, 72.0, 100.0, 94.1, 96.8),
    "first-person-deterministic": Row(86.0, 91.6, 88.8, 99.9, 93.7, 96.6),
    "secret-2": Row(93.6, 98.8, 96.6, 99.1, 99.1, 99.5),
    "secret-5": Row(94.3, 99.2, 96.9, 99.5, 100.0, 99.2),
    "plaintext": Row(95.2, 99.5, 97.1, 99.7, 99.5, 99.4),
}
