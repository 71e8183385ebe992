"""Where an equation comes from: the line in the user's own function."""

import functools
import inspect
import os
import sys
import sysconfig
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from typing import Any

from ciphernav_jax.jax_private import JaxprEqn, frames

# Where no line is a user's: in what is installed, wherever that is; in Python's own modules (a wrapper that
# `contextlib` makes); and in what evaluates a user's function.
_INSTALLED = {"site-packages", "dist-packages"}
_STANDARD = sysconfig.get_path("stdlib") + os.sep
_ENGINE = str(Path(__file__).parent) + os.sep
_PACKAGE = __name__.partition(".")[0]


@dataclass(frozen=True)
class Place:
    """A line of a function; line 0 where it is not known."""

    file: str
    line: int
    function: str

    def __str__(self) -> str:
        return f"{self.file}:{self.line} ({self.function})" if self.line else self.function

    @property
    def short(self) -> str:
        """Without the folder and the function."""
        return f"{Path(self.file).name}:{self.line}" if self.line else self.function


UNKNOWN = Place("", 0, "an unknown line")


def place(eqn: JaxprEqn, outside: Place) -> Place:
    """The innermost line of the user's own among those that led to the equation.

    The equations of a jitted function know nothing of its callers, so that inside a library's none of the
    lines is the user's. There it is `outside`, the place of the equation that calls the function.
    """
    for file, line, function in frames(eqn):
        if _of_user(file):
            return Place(file, line, function)
    return outside


@functools.cache  # asked for each frame of each equation
def _of_user(file: str) -> bool:
    # What Python runs without a file, its importing say, is written <frozen NAME>.
    return not (file.startswith((_ENGINE, _STANDARD, "<frozen ")) or _INSTALLED & {*Path(file).parts})


def of_function(function: Callable[..., Any]) -> Place:
    """Where the user wrote a function; of a library's, `jnp.exp`, the line that is being carried out, which
    names it.
    """
    function = inspect.unwrap(function)
    code = getattr(function, "__code__", None)
    if code and _of_user(code.co_filename):
        return Place(code.co_filename, code.co_firstlineno, function.__name__)
    frame: FrameType | None = sys._getframe()
    while frame is not None:
        code, module = frame.f_code, frame.f_globals.get("__name__", "")
        # A dataclass's methods have no file, but the names of their module.
        if _of_user(code.co_filename) and module.partition(".")[0] != _PACKAGE:
            return Place(code.co_filename, frame.f_lineno, code.co_qualname)
        frame = frame.f_back
    return UNKNOWN
