"""What all command lines share: ranges of options, and how a command ends.

It ends with one line that says why and names the way out, and with an exit code: 0 when it is done, 1 when it
cannot be done, 2 when its words cannot be read (`tyro`), 130 after Ctrl-C and 143 when it is told to end, as
shells have it.
"""

import errno
import os
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, NamedTuple, NoReturn, TypeVar, get_type_hints


class Within(NamedTuple):
    """The range of an option's number, or of each of its numbers."""

    least: int
    most: int


SEED = Within(0, 2**63 - 1)
PARTIES = Within(2, 1024)
COUNT = Within(1, 10**9)
WORKERS = Within(1, 1024)
SECONDS = Within(0, 10**9)

Options = TypeVar("Options")

REMEDIES = {
    errno.ENOSPC: "make room and run the same command again",
    errno.EDQUOT: "make room and run the same command again",
    errno.EACCES: "make it accessible, or name another",
    errno.EPERM: "make it accessible, or name another",
    errno.EROFS: "name a folder that can be written to",
}


def check(command: Any) -> None:
    """Refuse options out of range, and those of several values without any.

    Raises:
        ValueError: the message names the option.
    """
    for name, hint in get_type_hints(type(command), include_extras=True).items():
        value, option = getattr(command, name), f"--{name.replace('_', '-')}"
        if value == []:
            raise ValueError(f"{option} needs at least one value")
        numbers = value if isinstance(value, list) else [] if value is None else [value]
        for least, most in (said for said in getattr(hint, "__metadata__", ()) if isinstance(said, Within)):
            for number in numbers:
                if not least <= number <= most:
                    raise ValueError(f"{option} must lie in {least}..{most}, not at {number}")


def read(default: Options, doc: str | None) -> Options:
    """The options of a script, from its command line and in their ranges.

    Args:
        default: a dataclass: what they are unless said otherwise.
        doc: what stands above its `--help`.

    Raises:
        ValueError: see `check`.
    """
    import tyro  # here, so that the library does without it

    given = tyro.cli(type(default), description=doc, default=default)
    check(given)
    return given


@contextmanager
def one_line() -> Iterator[None]:
    """Ends the process by the rules above for whatever a user can do something about.

    Anything else is a fault of the program, and keeps its traceback.
    """
    before = signal.signal(signal.SIGTERM, _terminated)
    try:
        yield
    except KeyboardInterrupt:
        _end("interrupted; the same command goes on from here", 128 + signal.SIGINT)
    except BrokenPipeError:
        # Whoever read the output has gone; what is left of it must not be written as Python ends.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        _end("the output was closed", 1)
    except OSError as error:
        _end(_words(error), 1)
    except MemoryError as error:
        _end(f"not enough memory: {error}", 1)
    except (ValueError, RuntimeError) as error:
        _end(str(error), 1)
    finally:
        signal.signal(signal.SIGTERM, before)


def _terminated(number: int, _) -> NoReturn:
    _end("told to end; the same command goes on from here", 128 + number)


def _words(error: OSError) -> str:
    if error.errno is None:
        return str(error)
    said = f"{error.filename}: {error.strerror}" if error.filename else str(error)
    return f"{said}; {REMEDIES[error.errno]}" if error.errno in REMEDIES else said


def _end(why: str, code: int) -> NoReturn:
    print(f"ciphernav: {' '.join(why.split())}", file=sys.stderr)
    sys.exit(code)
