"""A measurement in a process of its own: an honest peak of memory, compile times with nothing prepared."""

import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

from ciphernav_jax.files import read_json, write_json
from ciphernav_jax.lifeline import end_with_parent, lifeline


def in_process(module: ModuleType, order: dict[str, Any], title: str, cache: str = "") -> dict[str, Any]:
    """What `python -m MODULE ORDER.json RESULT.json` answers to an order; it ends with this process.

    Args:
        module: its main program is `answer`.
        order, title: what to measure, for the module and for the reader of an error.
        cache: folder of JAX's compilation cache; without it nothing compiled is kept.

    Raises:
        RuntimeError: the process failed; the message has the last line that it wrote.
    """
    with tempfile.TemporaryDirectory() as folder, lifeline() as stdin:
        asked, answered = Path(folder) / "order.json", Path(folder) / "result.json"
        write_json(asked, order)
        done = subprocess.run(
            [sys.executable, "-m", module.__name__, str(asked), str(answered)],
            env=os.environ | {"JAX_COMPILATION_CACHE_DIR": cache},
            stdin=stdin,
            capture_output=True,
            text=True,
            check=False,
            start_new_session=True,  # Ctrl-C is for this process, which then ends the other
        )
        if done.returncode:
            last = (done.stderr.strip().splitlines() or [f"exit status {done.returncode}"])[-1]
            raise RuntimeError(f"{title} failed: {last}")
        return read_json(answered)


def answer(result_of: Callable[[dict[str, Any]], dict[str, Any]]) -> None:
    """The main program of a measurement: reads the order, and writes the result."""
    end_with_parent()
    order, result = map(Path, sys.argv[1:])
    write_json(result, result_of(read_json(order)))
