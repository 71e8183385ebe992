"""Fresh Python processes, for what is set once for a process."""

import os
import subprocess
import sys


def printed(code: str, *arguments: str, without: str | tuple[str, ...], **environment: str) -> str:
    """What `code` prints, with these variables and without those whose names begin with `without`."""
    kept = {name: value for name, value in os.environ.items() if not name.startswith(without)}
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", code, *arguments],
        env=kept | environment,
        capture_output=True,
        text=True,
        check=True,
    )
    return done.stdout.strip()
