"""The numbers printed in the paper (Lu, Chiquier, Vondrick, NeurIPS 2022); shares in percent.

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


class Failures(NamedTuple):
    """How the episodes that fail end; of `TRIALS`, half of which require a detour."""

    crash_obstacle: int
    crash_wall: int
    no_crash: int


TRIALS = 4_500
FAILURES = {
    "map-only": Failures(1309, 0, 0),
    "first-person": Failures(1252, 0, 0),
    "first-person-deterministic": Failures(491, 13, 0),
    "secret-2": Failures(144, 16, 10),
    "secret-5": Failures(115, 21, 11),
    "plaintext": Failures(105, 2, 11),
}


class Forward(NamedTuple):
    """Seconds of a forward pass of the action classifier, batch 100."""

    gpu: float
    cpu: float


FORWARD = {None: Forward(0.00028, 0.00032), 2: Forward(0.15, 0.23), 5: Forward(0.42, 1.3)}
"""By the number of parties, None in plaintext."""

RECONSTRUCTION = {"chance": 50.0, "shares": 49.7, "features": 93.6}
"""Accuracy of telling whether there is an obstacle in a camera's view, from what the attacker is given."""

TRAINING_S = 3 * 24 * 3600.0
TRAINING_EPOCHS = 600
"""Of the classifier under secret sharing, on a GPU."""
