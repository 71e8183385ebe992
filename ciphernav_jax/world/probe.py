"""Whether OpenGL works here: `python -m ciphernav_jax.world.probe` draws one view."""

import sys

from ciphernav_jax.world.gl import GLUnavailable


def probe() -> str:
    """Draws one view and returns the names of the GL renderer and its version.

    Raises:
        GLUnavailable: when that fails.
    """
    from ciphernav_jax.world.renderer import renderer  # fails at once where there is no OpenGL

    renderer().render(0, (), [0])
    return renderer().gl


def main() -> int:
    """Prints the GL renderer, or what to install; 0 when OpenGL works, 1 otherwise."""
    try:
        print(probe())
    except GLUnavailable as error:
        print(error, file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
