from ciphernav_jax import provenance


def test_versions_are_those_of_what_is_installed(monkeypatch):
    monkeypatch.setattr(provenance, "PACKAGES", ("jax", "nobody_has_this"))
    assert set(provenance.versions()) == {"python", "jax"}


def test_machine_and_time_are_told():
    assert provenance.machine()["cpus"] in range(1, 2**20)
    assert provenance.now().endswith("+00:00")
