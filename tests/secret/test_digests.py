"""A sample of the digests is that of what is computed now; `python -m tests.secret.digests` has them all."""

import json
from pathlib import Path

import jax
import pytest

from ..slow import slow
from . import digests

RECORDED = json.loads(Path(__file__).with_name("digests.json").read_text())
CALLS = dict(digests.calls())
SAMPLE = [*[name for name in CALLS if not name.startswith("variant")][::9], "variant comparison=ideal"]

pytestmark = pytest.mark.skipif(
    jax.__version__ != RECORDED["jax"], reason="another JAX may trace the same functions otherwise"
)


@pytest.mark.parametrize("name", [*SAMPLE[:2], *slow(*SAMPLE[2:])])
def test_the_bits_are_those_that_were_recorded(name):
    assert digests.digest(name, CALLS[name], 2) == RECORDED["digests"]["2"][name]


@pytest.mark.slow
@pytest.mark.parametrize("parties", [3, 5])
@pytest.mark.parametrize("name", SAMPLE[3:-1:3])
def test_so_they_are_with_more_parties(name, parties):
    assert digests.digest(name, CALLS[name], parties) == RECORDED["digests"][str(parties)][name]


def test_every_call_was_recorded():
    for_two = {name for name, call in CALLS.items() if call.protocol.truncation == "local"}
    for parties, recorded in RECORDED["digests"].items():
        expected = {*CALLS, "training", "loops: scan"} - (for_two if parties != "2" else set())
        assert set(recorded) >= expected
    assert set(RECORDED["digests"]) == set(map(str, digests.PARTIES))


@pytest.mark.slow
def test_loops_and_training_end_with_the_recorded_bits():
    recorded = RECORDED["digests"]["2"]
    assert digests.trained(2) == recorded["training"]
    looped = digests.looped(2)
    assert looped == {name: recorded[name] for name in looped}
