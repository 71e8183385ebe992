import os
import subprocess
import sys

import pytest

from ciphernav_jax.world import probe
from tests.patience import PATIENCE_S


def python(program, **variables):
    return subprocess.run(
        [sys.executable, "-c", program],
        env={**os.environ, **variables},
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
    )


def assert_says_what_to_install(result):
    assert result.returncode == 1
    assert "Traceback" not in result.stderr
    assert "apt-get install libegl1 libgl1 libglu1-mesa libgl1-mesa-dri" in result.stderr
    assert len(result.stderr.strip().splitlines()) == 1


PROBE = "import sys; from ciphernav_jax.world import probe; sys.exit(probe.main())"

# ctypes loads no library with this in its name, as if it were not installed.
WITHOUT = """
import ctypes, ctypes.util
find, load = ctypes.util.find_library, ctypes.CDLL.__init__
def refuse(self, name, *args, **kwargs):
    if name and "{library}" in str(name):
        raise OSError(f"{{name}}: cannot open shared object file")
    load(self, name, *args, **kwargs)
ctypes.CDLL.__init__ = refuse
ctypes.util.find_library = lambda name: None if name == "{library}" else find(name)
"""


def test_probe_names_the_renderer():
    result = subprocess.run(
        [sys.executable, "-m", "ciphernav_jax.world.probe"],
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
    )
    assert result.returncode == 0, result.stderr
    assert "OpenGL" in result.stdout
    assert result.stdout.strip() == probe.probe()


@pytest.mark.parametrize("library", ["GLU", "EGL"])
def test_missing_library(library):
    result = python(WITHOUT.format(library=library) + PROBE, DISPLAY="")
    assert_says_what_to_install(result)
    assert library in result.stderr


def test_display_that_is_not_there():
    result = python(PROBE, DISPLAY=":4242")
    assert_says_what_to_install(result)
    assert "DISPLAY is ':4242'; unset it" in result.stderr


def test_workers_and_readers_import_neither_jax_nor_more_than_they_need():
    worker = "import sys, ciphernav_jax.world.renderer, ciphernav_jax.world.shards; "
    assert python(worker + "assert 'jax' not in sys.modules").returncode == 0
    reader = "import sys, ciphernav_jax.world.dataset, ciphernav_jax.world.topview; "
    result = python(reader + "assert not {'jax', 'miniworld', 'pyglet'} & set(sys.modules)")
    assert result.returncode == 0, result.stderr
