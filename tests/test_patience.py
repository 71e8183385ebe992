"""No test depends on the clock."""

import re
from pathlib import Path

TESTS = Path(__file__).parent
TIMED = re.compile(r"timeout\w*=\d|deadline=\d|time\.sleep\([\d.]+\)\n\s+assert")


def test_tests_wait_for_events_with_the_same_patience():
    timed = {
        str(path.relative_to(TESTS)): TIMED.findall(path.read_text())
        for path in TESTS.rglob("*.py")
        if path != Path(__file__)
    }
    assert not {path: found for path, found in timed.items() if found}
