"""Child processes that end with their parent, however it ends.

The parent holds one end of a pipe, and the child's standard input is the other. The kernel closes the
parent's end when the parent dies, by SIGKILL too; then the child's read returns.
"""

import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def lifeline() -> Iterator[int]:
    """In the parent: yields what to give children as `stdin`; it closes with the context, or the process."""
    theirs, ours = os.pipe()
    try:
        yield theirs
    finally:
        os.close(ours)
        os.close(theirs)


def end_with_parent() -> None:
    """In a child: from now on its end is the end of its `lifeline`, in the midst of whatever it does."""

    def watch() -> None:
        os.read(0, 1)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
