"""JAX's persistent compilation cache, on by default: what was compiled once is read from disk the next time.

A step of secret training compiles for seconds. The folder is
`$XDG_CACHE_HOME/ciphernav_jax/xla-<processor>`, by default under `~/.cache`; it can be deleted at any time.
Setting JAX_COMPILATION_CACHE_DIR chooses another folder, and setting it to nothing switches the cache off.

JAX does not write its entries aside: one cut short by a kill is not used, and warned of at each compilation
until it is deleted.
"""

import hashlib
import os
import platform
import sys
from pathlib import Path

VARIABLE = "JAX_COMPILATION_CACHE_DIR"


def switch_on() -> None:
    """Name the folder to JAX, whether it is imported already or not, unless somebody has named one."""
    if VARIABLE in os.environ or (folder := default_folder()) is None:
        return
    if "jax" not in sys.modules:
        os.environ[VARIABLE] = str(folder)
    elif sys.modules["jax"].config.jax_compilation_cache_dir is None:
        sys.modules["jax"].config.update("jax_compilation_cache_dir", str(folder))


def default_folder() -> Path | None:
    """The cache's folder, made if need be; None where nothing can be written."""
    home = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
    folder = Path(home) / "ciphernav_jax" / f"xla-{_processor()}"
    if not folder.is_absolute():  # the XDG specification: a relative path counts as not set
        return None
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:  # a read-only home; JAX would complain at every compilation
        return None
    return folder if os.access(folder, os.W_OK) else None


def _processor() -> str:
    # XLA compiles for the processor it runs on, and JAX's key does not tell processors apart: a home folder
    # that two machines share must not hand one the instructions of the other.
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        lines = []
    wanted = ("model name", "flags", "Features", "CPU part")
    described = sorted({line for line in lines if line.startswith(wanted)}) or [platform.processor()]
    return hashlib.sha256("\n".join([platform.machine(), *described]).encode()).hexdigest()[:12]
