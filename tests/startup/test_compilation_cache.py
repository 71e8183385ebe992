import os

import pytest

from tests.fresh import printed

VARIABLE = "JAX_COMPILATION_CACHE_DIR"
SHOW = "import jax; print(jax.config.jax_compilation_cache_dir or 'off')"
IMPORTED = "import ciphernav_jax;"


def says(code, **environment):
    """What fresh Python prints, without a cache named by whoever runs the tests."""
    return printed(code, without=VARIABLE, **environment)


@pytest.mark.parametrize("code", [IMPORTED + SHOW, "import jax;" + IMPORTED + SHOW])
def test_the_folder_is_the_users_own_and_the_processors(code, tmp_path):
    folder = says(code, XDG_CACHE_HOME=str(tmp_path))
    assert os.path.dirname(folder) == str(tmp_path / "ciphernav_jax")
    assert folder == says(code, XDG_CACHE_HOME=str(tmp_path))


def test_another_processor_has_another_folder(tmp_path):
    code = "from ciphernav_jax.startup import compilation_cache as c;"
    code += "from pathlib import Path; print(c.default_folder());"
    code += "Path.read_text = lambda _: 'flags: none'; print(c.default_folder())"
    here, there = says(code, XDG_CACHE_HOME=str(tmp_path)).splitlines()
    assert here != there


def test_what_was_compiled_is_kept(tmp_path):
    code = IMPORTED + "import jax; jax.config.update('jax_persistent_cache_min_compile_time_secs', 0);"
    code += "import jax.numpy as jnp; print(jax.jit(lambda x: jnp.sum(x * x))(jnp.ones(3)))"
    assert says(code, XDG_CACHE_HOME=str(tmp_path)) == "3.0"
    assert list((tmp_path / "ciphernav_jax").glob("xla-*/*-cache"))


def test_a_choice_made_before_is_respected(tmp_path):
    chosen = str(tmp_path / "mine")
    assert says(IMPORTED + SHOW, **{VARIABLE: chosen}) == chosen
    assert says(IMPORTED + SHOW, **{VARIABLE: ""}) == "off"
    code = f"import jax; jax.config.update('jax_compilation_cache_dir', {chosen!r});" + IMPORTED + SHOW
    assert says(code, XDG_CACHE_HOME=str(tmp_path)) == chosen


def test_a_home_that_cannot_be_written_does_no_harm(tmp_path):
    file = tmp_path / "file"
    file.write_text("")
    code = IMPORTED + SHOW + "; print(jax.jit(lambda x: x + 1)(1))"
    for home in (str(file), "/proc/nowhere", "relative"):
        assert says(code, XDG_CACHE_HOME=home) == "off\n2"
