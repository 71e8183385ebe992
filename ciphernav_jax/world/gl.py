"""OpenGL, or a message that says what is missing.

MiniWorld draws with OpenGL through pyglet. Without a display pyglet renders headless by EGL;
that has to be chosen before MiniWorld is imported, so all imports of it go through here.
"""

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager

PACKAGES = ("libegl1", "libgl1", "libglu1-mesa", "libgl1-mesa-dri")
"""The Debian packages that software rendering needs."""


class GLUnavailable(RuntimeError):
    """OpenGL cannot be used here; the message says what to install."""


@contextmanager
def required() -> Iterator[None]:
    """Imports and uses of MiniWorld inside this context fail with one clear message.

    Chooses headless rendering when no display is named.

    Raises:
        GLUnavailable: in place of whatever pyglet, ctypes or the driver raised.
    """
    try:
        import pyglet

        if sys.platform == "linux" and not os.environ.get("DISPLAY"):
            pyglet.options["headless"] = True
        yield
    except Exception as error:
        display = os.environ.get("DISPLAY")
        hint = f" DISPLAY is {display!r}; unset it to render without one." if display else ""
        raise GLUnavailable(
            "Obstacle World is drawn with OpenGL, which does not work here "
            f"({type(error).__name__}: {error}).{hint} "
            f"On Debian or Ubuntu: apt-get install {' '.join(PACKAGES)}"
        ) from error
