"""Compiled programs, let go before memory maps run out.

XLA's CPU backend loads every kernel of a program into memory maps of its own. A small function with its
gradient takes hundreds, Linux gives a process 65,530 (`vm.max_map_count`), and XLA crashes when none are
left. So the maps are counted whenever a function on secrets is about to be compiled, by itself or as a part
of another. Where half of them are taken, programs are let go until a third is: the functions on secrets that
were called longest ago, and if that is not enough, all that JAX holds. What is called again is compiled
again. A program that runs is kept until it ends. Where there is no /proc nothing is counted.
"""

import functools
import logging
import threading
import weakref
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax

from ciphernav_jax.jax_private import is_tracing

MAPS = Path("/proc/self/maps")
ALLOWED = Path("/proc/sys/vm/max_map_count")

_log = logging.getLogger("ciphernav_jax")
_lock = threading.RLock()


class Compiled:
    """`jax.jit(function)`, for functions on secrets."""

    def __init__(self, function: Callable[..., Any]):
        self._function = function
        self._jitted = self._not_compiled()

    def _not_compiled(self) -> Any:
        @functools.wraps(self._function)
        def traced(*args):
            _make_room(self)
            return self._function(*args)

        return jax.jit(traced)

    def __call__(self, *args: Any) -> Any:
        with _lock:
            _by_last_call.pop(self, None)
            _by_last_call[self] = None
        if is_tracing():
            # What is about to be compiled is another function; this one may have been traced before.
            _make_room(self)
        return self._jitted(*args)

    def let_go(self) -> None:
        """Forgets what was compiled and what was traced, so that it is counted when it is compiled again."""
        self._jitted.clear_cache()
        self._jitted = self._not_compiled()


_by_last_call: "weakref.WeakKeyDictionary[Compiled, None]" = weakref.WeakKeyDictionary()
_kept = 0  # maps that were taken when all had been let go, and so by something else


def _make_room(current: Compiled) -> None:
    """Lets go of programs, but not of the `current` one, where half of the maps for them are taken."""
    try:
        taken, allowed = _count(), int(ALLOWED.read_text())
    except OSError:
        return
    with _lock:
        if taken > _kept + (allowed - _kept) // 2:
            left = _let_go(current, _kept + (allowed - _kept) // 3)
            _log.warning(
                "%d memory maps were taken, most of them by compiled programs; a process may have %d. "
                "Programs were let go, and %d maps are left. What is called again is compiled again.",
                taken,
                allowed,
                left,
            )


def _let_go(current: Compiled, enough: int) -> int:
    """Lets go of programs until `enough` maps or fewer are taken; how many are."""
    global _kept
    programs = [program for program in _by_last_call if program is not current]
    quarter = -(-len(programs) // 4)
    while programs:
        for program in programs[:quarter]:
            program.let_go()
            del _by_last_call[program]
        programs = programs[quarter:]
        if (left := _count()) <= enough:
            return left
    jax.clear_caches()
    _kept = _count()
    return _kept


def _count() -> int:
    with MAPS.open("rb") as lines:
        return sum(1 for _ in lines)
