"""Where an equation comes from: the line in the user's own function."""

import inspect
import sysconfig
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ciphernav_jax.jax_private import JaxprEqn, frames

# What is installed is no user's; nor is what evaluates a user's function.
_INSTALLED = tuple({sysconfig.get_path("purelib"), sysconfig.get_path("platlib")})
_ENGINE = str(Path(__file__).parent)


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
        if not file.startswith((*_INSTALLED, _ENGINE)):
            return Place(file, line, function)
    return outside


def of_function(function: Callable[..., Any]) -> Place:
    """Where a function is defined."""
    function = inspect.unwrap(function)
    name = getattr(function, "__name__", type(function).__name__)
    code = getattr(function, "__code__", None)
    return Place(code.co_filename, code.co_firstlineno, name) if code else Place("", 0, name)
