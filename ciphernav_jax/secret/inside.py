"""Whether a function on secrets is being traced: to it, secrets are plain arrays.

There is nothing to share in it, and nothing to open: `reveal` would return what it is given, and what follows
would count as secret all the same. A function on secrets within another would find no secret. And what a
function closes over is a constant that all parties know. So these are refused.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

_traced = ContextVar("traced", default=False)

CLOSED_OVER = (
    "A function on secrets knows those that are its arguments, and closes over public values alone. Give it "
    "the Secret as an argument: secure(f)(key, x)."
)


@contextmanager
def traced() -> Iterator[None]:
    """Within it a function on secrets is traced."""
    token = _traced.set(True)
    try:
        yield
    finally:
        _traced.reset(token)


def is_traced() -> bool:
    """Whether what is called now is part of a function on secrets."""
    return _traced.get()


def require_outside(what: str, instead: str) -> None:
    """Raises TypeError inside a function on secrets: `what` was called there, `instead` is the way out."""
    if is_traced():
        raise TypeError(
            f"{what} is called inside a function on secrets, in which secrets are plain arrays. {instead}"
        )
