"""The library without its extras: functions on secrets need none of them, and what does says which."""

import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from ciphernav_jax import extras

from .patience import PATIENCE_S

ROOT = Path(__file__).parents[1]

# As in an environment where none of the extras' modules is installed.
WITHOUT = f"""
import sys
sys.modules.update(dict.fromkeys({extras.NEEDED["navigation"]!r}))
"""
SECRET = """
import jax, numpy as np
import ciphernav_jax as cn
cn.compare
x = cn.share(jax.random.key(0), np.array([1.5, -2.0]), parties=3)
step = cn.secure(jax.grad(lambda x: jax.numpy.sum(jax.nn.relu(x) ** 2)))
print(cn.reveal(step(jax.random.key(1), x)), cn.cost(step, x), cn.validate(step)(jax.random.key(2), x)[1])
"""


def run(code):
    return subprocess.run(
        [sys.executable, "-c", WITHOUT + code],
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
        check=False,
        cwd=ROOT,
    )


def test_functions_on_secrets_need_no_extra():
    done = run(SECRET)
    assert done.returncode == 0, done.stderr
    assert "[3. 0.]" in done.stdout


@pytest.mark.parametrize("name", ["world", "models", "navigation", "cli"])
def test_what_needs_an_extra_says_which(name):
    done = run(f"import ciphernav_jax.{name}")
    assert done.returncode == 1
    last = done.stderr.strip().splitlines()[-1]
    assert "pip install 'ciphernav_jax[navigation]'" in last
    assert "gymnasium" in last


def test_the_wheel_holds_the_library_alone(tmp_path):
    subprocess.run(
        [sys.executable, "-m", "hatchling", "build", "--target", "wheel", "--directory", str(tmp_path)],
        cwd=ROOT,
        check=True,
        capture_output=True,
        timeout=PATIENCE_S,
    )
    (wheel,) = tmp_path.glob("*.whl")
    held = set(zipfile.ZipFile(wheel).namelist())
    modules = {path.relative_to(ROOT).as_posix() for path in (ROOT / "ciphernav_jax").rglob("*.py")}
    about = {name for name in held if ".dist-info/" in name}
    assert held - about == modules | {"ciphernav_jax/py.typed"}
