"""A window that shows pictures, for `render_mode="human"`."""

import gymnasium
import numpy as np
from numpy.typing import NDArray

from ciphernav_jax.world import gl

with gl.required():
    import pyglet


class Window:
    """A window of `width` x `height` pixels. Without a display there is nothing to see, with a warning."""

    def __init__(self, width: int, height: int, caption: str):
        if pyglet.options["headless"]:
            gymnasium.logger.warn('There is no display to show a window on; use render_mode="rgb_array".')
        with gl.required():
            self._window = pyglet.window.Window(width, height, caption)

    def show(self, picture: NDArray[np.uint8]) -> None:
        """Shows uint8[height, width, 3]."""
        height, width, _ = picture.shape
        image = pyglet.image.ImageData(width, height, "RGB", picture.tobytes(), pitch=-3 * width)
        self._window.switch_to()
        self._window.dispatch_events()
        self._window.clear()
        image.blit(0, 0)
        self._window.flip()

    def close(self) -> None:
        """Closes the window."""
        self._window.close()
