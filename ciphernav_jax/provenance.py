"""On what and when a result was made: versions, machine, time, for the JSON beside every number."""

import os
import platform
from contextlib import suppress
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

PACKAGES = ("ciphernav_jax", "jax", "jaxlib", "flax", "optax", "numpy", "miniworld")


def versions() -> dict[str, str]:
    """Python's version and those of the packages that decide results, as far as they are installed."""
    found = {"python": platform.python_version()}
    for name in PACKAGES:
        with suppress(PackageNotFoundError):  # an extra that is left out
            found[name] = version(name)
    return found


def machine() -> dict[str, str | int]:
    """The operating system, the processor's name and how many of them."""
    return {"system": platform.platform(), "processor": _processor(), "cpus": os.cpu_count() or 1}


def now() -> str:
    """The time, to the minute."""
    return datetime.now(UTC).isoformat(timespec="minutes")


def _processor() -> str:
    cpuinfo = Path("/proc/cpuinfo")
    if cpuinfo.exists():
        for line in cpuinfo.read_text().splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()
