"""The code on the documentation's pages: what each block prints, beside the output that stands below it.

    python -m tests.pages docs/tutorials/*.md     # writes the outputs anew, and says what took how long

A page is one program: its ```python blocks run in their order in one namespace, in an empty folder. A ```text
block right below one is what it prints. A block ```python no-run does not run; a comment above it says why.
"""

import contextlib
import io
import os
import re
import subprocess
import sys
import tempfile
import time
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

BLOCK = re.compile(r"^```python( no-run)?\n(.*?)^```\n(?:\n```text\n(.*?)^```\n)?", re.DOTALL | re.MULTILINE)


class Ran(NamedTuple):
    """A block that ran: what it printed, what stands below it (None where nothing does), and the seconds."""

    printed: str
    shown: str | None
    seconds: float


def run(text: str, folder: Path, names: dict | None = None) -> Iterator[Ran]:
    """Runs a page's blocks, one after the other, in a folder; `names` is their namespace."""
    names = {} if names is None else names
    names["__name__"] = "example"
    for skipped, code, shown in BLOCK.findall(text):
        if skipped:
            continue
        began = time.perf_counter()
        with contextlib.chdir(folder), contextlib.redirect_stdout(io.StringIO()) as out:
            exec(compile(code, "example.py", "exec"), names)  # the page's own code
        yield Ran(out.getvalue(), shown or None, time.perf_counter() - began)


def anew(path: Path) -> None:
    """Writes a page's outputs anew, and says what each block printed."""
    began = os.times()
    with tempfile.TemporaryDirectory() as folder:
        found = iter(list(run(path.read_text(), Path(folder))))

    def block(old: re.Match) -> str:
        if old[1]:
            return old[0]
        ran = next(found)
        print(f"{path}: {ran.seconds:.1f} s\n{ran.printed}", end="", flush=True)
        if old[3] is None:
            return old[0]
        return f"```python\n{old[2]}```\n\n```text\n{ran.printed}```\n"

    path.write_text(BLOCK.sub(block, path.read_text()))
    ended = os.times()
    print(f"{path}: {ended.user + ended.system - began.user - began.system:.0f} s of the processor")


def main() -> None:
    """Each page in a process of its own, as its reader has one: there a key given twice is an error."""
    pages = sys.argv[1:]
    if len(pages) == 1:
        from ciphernav_jax import KeyReuseWarning

        warnings.simplefilter("error", KeyReuseWarning)
        anew(Path(pages[0]))
        return
    for page in pages:
        subprocess.run([sys.executable, "-m", "tests.pages", page], check=True)


if __name__ == "__main__":
    main()
