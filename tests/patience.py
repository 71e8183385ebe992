"""Tests wait for events, however long these take. Only what never comes is given up: later than any machine
needs, however busy it is.
"""

import time
from collections.abc import Callable

PATIENCE_S = 1200


def wait_for(condition: Callable[[], bool]) -> None:
    """Returns when the condition holds."""
    until = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < until
        time.sleep(0.01)
