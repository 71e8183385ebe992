"""Parameters that `make test` leaves to `make test-slow`; whole tests and files have the mark itself."""

import pytest


def slow(*values):
    """These values of a parameter, or of several together, marked `slow`."""
    return [
        pytest.param(*(value if isinstance(value, tuple) else (value,)), marks=pytest.mark.slow)
        for value in values
    ]
