"""A measurement in a process of its own: an honest peak of memory, compile times with nothing prepared."""

import os
import subprocess
import sys
import tempfile
from pathlib import Path
from types import ModuleType
from typing import Any

from ciphernav_jax.files import read_json, write_json


def run(module: ModuleType, order: dict[str, Any], title: str, cache: str = "") -> dict[str, Any]:
    """What `python -m MODULE ORDER.json RESULT.json` answers to an order.

    Args:
        module: its main program reads the order and writes the result.
        order, title: what to measure, for the module and for the reader of an error.
        cache: folder of JAX's compilation cache; without it nothing compiled is kept.

    Raises:
        RuntimeError: the process failed; the message has the last lines that it wrote.
    """
    with tempfile.TemporaryDirectory() as folder:
        asked, answer = Path(folder) / "order.json", Path(folder) / "result.json"
        write_json(asked, order)
        done = subprocess.run(
            [sys.executable, "-m", module.__name__, str(asked), str(answer)],
            env=os.environ | {"JAX_COMPILATION_CACHE_DIR": cache},
            capture_output=True,
            text=True,
            check=False,
        )
        if done.returncode:
            last = "\n".join(done.stderr.strip().splitlines()[-5:])
            raise RuntimeError(f"{title} failed:\n{last}")
        return read_json(answer)
