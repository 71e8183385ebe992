import json
import os
import sys
from dataclasses import replace
from typing import get_args

import jax
import numpy as np
import pytest
from rich.console import Console

from ciphernav_jax import files
from ciphernav_jax.protocols import Protocol
from ciphernav_jax.secret import share
from experiments import bench, floor, peers
from experiments.growth import Turns, growth
from experiments.measure import Order, measure, summary
from experiments.options import WorkName
from experiments.peers import harness
from experiments.work import RATE, Sizes, error, works
from tests.patience import wait_for

pytestmark = pytest.mark.slow

TINY = Sizes(widths=(6, 4, 3), forward=2, train=5, steps=2, relu=9, product=(3, 4, 5))
# Of a value: rounding each input, and one truncation for each product.
UNIT = 2.0**-20


def test_the_raw_rates_are_measured():
    assert all(0 < rate < np.inf for rate in floor.rates().values())


def test_the_works_are_the_papers():
    known = works()
    assert tuple(known) == get_args(WorkName)
    weights, features, labels = known["train"].args
    assert sum(kernel.size + bias.size for kernel, bias in weights) == 46_373
    assert (features.shape, labels.shape) == ((500, 288), (500, 5))
    assert known["relu"].args[0].shape == (100_000,)
    assert known["product"].products == ((500, 288, 128),)
    layers = 288 * 128 + 128 * 64 + 64 * 16 + 16 * 5
    assert sum(m * k * n for m, k, n in known["forward"].products) == 100 * layers
    assert sum(m * k * n for m, k, n in known["train"].products) == 500 * (3 * layers - 288 * 128)


def test_a_loop_is_its_steps_one_after_the_other():
    once, loop = works(TINY)["train"], works(TINY)["train-loop"]
    weights = once.args[0]
    for _ in range(TINY.steps):
        weights, _ = once.function(weights, *once.args[1:])
    np.testing.assert_allclose(error(loop.expected()[0], weights), 0, atol=1e-14)


@pytest.mark.parametrize("name", ["product", "forward-public", "train-loop"])
def test_a_measurement(name):
    order = Order(name, 3, sizes=TINY, repeat=2)
    assert Order.from_json(json.loads(json.dumps(order.as_json()))) == order
    found = measure(order)
    assert found["seconds"]["repeats"] == 2
    assert 0 < found["seconds"]["q1"] <= found["seconds"]["median"] <= found["seconds"]["q3"]
    assert min(found["trace_s"], found["compile_s"]) > 0
    assert found["peak_bytes"] > 50e6
    # Entries below 4 in a contraction of at most 6, a few of them in a row.
    assert 0 < found["error"] < 100 * UNIT


def test_growth_is_measured_in_turns():
    turns = Turns("product", (2, 5), rounds=3, sizes=TINY)
    assert Turns.from_json(json.loads(json.dumps(turns.as_json()))) == turns
    fewest, more = growth(turns)
    assert (fewest["parties"], more["parties"]) == (2, 5)
    assert fewest["growth"] == {"median": 1.0, "q1": 1.0, "q3": 1.0, "repeats": 3}
    assert 0 < more["growth"]["q1"] <= more["growth"]["median"] <= more["growth"]["q3"]
    for found in (fewest, more):
        assert found["seconds"]["repeats"] == 3
        args = tuple(jax.eval_shape(lambda p=found["parties"]: shared(works(TINY)["product"], p)))
        assert found["needs"] == floor.needs(works(TINY)["product"], Protocol(), found["parties"], args)


def test_growth_beside_that_of_the_floor():
    def result(parties, seconds, grown, needed):
        times, ratios = summary([seconds]), summary([grown])
        return {
            "work": "train",
            "parties": parties,
            "seconds": times,
            "growth": ratios,
            "needs": {"random_bytes": needed},
        }

    document = {"rates": {}, "results": [], "growth": [result(2, 0.01, 1.0, 8), result(4, 0.03, 1.5, 20)]}
    bench._compare(document, {"random_bytes": 1000.0})
    assert bench.growth_rows(document, {"train": "a step"}) == [
        ("a step", "2", "5", "5-5", "1.00", "1.00-1.00", "1.00"),
        ("a step", "4", "7.5", "7.5-7.5", "1.50", "1.50-1.50", "1.25"),
    ]


def test_what_a_product_needs():
    # Dealer: a, b, and their product; masks to share all three and the truncation's; two parties.
    m, k, n = TINY.product
    work = works(TINY)["product"]
    args = tuple(jax.eval_shape(lambda: shared(work)))
    found = floor.needs(work, Protocol(), 2, args)
    assert found["multiply_adds"] == (1 + 2 * 2) * m * k * n
    assert found["random_bytes"] == 8 * (2 * (m * k + k * n) + m * n + m * n + 3 * m * n)
    assert floor.seconds(found, {"multiply_adds": 1.0, "random_bytes": 2.0}) == (
        found["multiply_adds"] + found["random_bytes"] / 2
    )


def shared(work, parties=2):
    return share(jax.random.key(0), work.args, parties=parties)


def test_summary_and_error():
    assert summary([3.0, 1.0, 2.0]) == {"median": 2.0, "q1": 1.5, "q3": 2.5, "repeats": 3}
    assert error([np.array([1.0, 2.5]), np.array([9.0])], [np.array([1.0, 2.0]), np.array([10.0])]) == 0.25
    assert error([0.5], [0.25]) == 0.25


class Torchlike(np.ndarray):
    def square(self):
        return self * self


def test_the_step_by_hand_is_the_step():
    work = works(TINY)["train"]
    weights, x, y = jax.tree.map(lambda a: a.view(Torchlike), work.args)
    job = harness.Job("train", RATE, [], [], "", 2, 1, [])
    found = harness.by_hand(job, weights, x, y, transpose=np.transpose, column_sum=lambda a: a.sum(axis=0))
    assert error(found, work.expected()) < 1e-13


@pytest.fixture
def fake(tmp_path):
    """Makes a peer from a few lines of Python; its environment is this one."""
    home = tmp_path / "peers" / "environments" / "fake"
    (home / "bin").mkdir(parents=True)
    python = home / "bin" / "python"
    python.write_text(f'#!/bin/sh\nexec {sys.executable} "$@"\n')
    python.chmod(0o755)
    files.write_json(home / "complete.json", {"installs": []})

    def peer(title, code):
        worker = tmp_path / f"{title}.py"
        path = os.path.dirname(harness.__file__)
        worker.write_text(
            f"import sys, time; sys.path.insert(0, {path!r})\nfrom harness import job, save\n{code}\n"
        )
        return peers.Peer(title, peers.Environment("fake", ()), worker, (2, 3), ("more",))

    return peer


GOOD = """
j = job()
assert j.more == ["more"]
x, y = j.data
save(j.result, [1.0, 2.0, 4.0], [x @ y])
"""


def test_the_whole_bench(fake, tmp_path, capsys):
    document = bench.benchmark(
        parties=[2],
        names=["product"],
        protocols=[Protocol(), Protocol(frac_bits=16)],
        out=tmp_path,
        repeat=1,
        with_peers=[fake("broken", "print('no such thing'); sys.exit(3)"), fake("good", GOOD)],
        sizes=TINY,
    )
    assert files.read_json(tmp_path / "bench.json") == json.loads(json.dumps(document))
    assert [(r["work"], r["protocol"]) for r in document["results"]] == [
        ("product", "default"),
        ("product", "frac_bits=16"),
    ]
    for result in document["results"]:
        assert result["warm_s"] > 0
        assert result["times_floor"] == result["seconds"]["median"] / result["floor_s"]
    assert document["results"][0]["target_s"] == bench.TARGETS["product", 2]
    assert document["results"][1]["target_s"] is None

    broken, good = document["peers"]
    assert (broken["status"], broken["detail"]) == ("failed", "no such thing")
    assert good["seconds"]["median"] == 2
    assert good["error"] < 1e-6
    shown = capsys.readouterr().out
    assert all(words in shown for words in ("product 3x4x5", "no such thing", "Written"))
    ours = document["results"][0]["seconds"]["median"]
    assert f"2000 ({2 / ours:.1f})" in bench.markdown(document)
    assert (tmp_path / "bench.md").read_text() == bench.markdown(document)


def run_peers(peer, tmp_path, parties=(2,), limit=60.0):
    work = [works(TINY)["product"]]
    return peers.run_worker([peer], work * 2, parties, tmp_path / "peers", None, limit, Console(quiet=True))


def test_what_is_finished_is_kept(fake, tmp_path):
    first = run_peers(fake("peer", GOOD), tmp_path)
    broken = fake_again = fake_worker(tmp_path, "peer")
    assert run_peers(broken, tmp_path) == first
    # Another version is another question.
    home = tmp_path / "peers" / "environments" / "fake"
    files.write_json(home / "complete.json", {"installs": [["peer==2"]]})
    newer = replace(fake_again, environment=peers.Environment("fake", (("peer==2",),)))
    assert [r["status"] for r in run_peers(newer, tmp_path)] == ["failed"] * 2


def fake_worker(tmp_path, title):
    worker = tmp_path / f"{title}.py"
    worker.write_text("raise SystemExit('broken since')")
    return peers.Peer(title, peers.Environment("fake", ()), worker, (2, 3), ("more",))


def test_one_that_hangs_is_ended_with_all_it_started(fake, tmp_path):
    held = tmp_path / "held by who lives"
    os.mkfifo(held)
    reader = os.open(held, os.O_RDONLY | os.O_NONBLOCK)
    child = f"import time; held = open({str(held)!r}, 'w'); time.sleep(10**6)"
    code = f"import subprocess\nsubprocess.Popen([sys.executable, '-c', {child!r}])\ntime.sleep(10**6)"
    results = run_peers(fake("slow", code), tmp_path, parties=(2, 7), limit=2)
    # Once for two parties, where the second, longer work is not tried; seven it cannot do.
    assert [r["status"] for r in results] == ["did not finish", "not tried"]

    def nobody_lives():
        try:
            return os.read(reader, 1) == b""
        except BlockingIOError:
            return False

    wait_for(nobody_lives)
    os.close(reader)


def test_one_that_cannot_be_installed_is_said_so(fake, tmp_path):
    peer = replace(fake("gone", GOOD), environment=peers.Environment("gone", (("something",),)))
    (tmp_path / "peers" / "environments" / "gone").write_text("a file in its place")
    results = run_peers(peer, tmp_path)
    assert [r["status"] for r in results] == ["not installed"] * 2
    assert "gone" in results[0]["detail"]


@pytest.mark.parametrize(
    ("asked", "message"),
    [
        ({"names": ["relu", "sort"]}, "unknown work sort"),
        ({"parties": [1]}, "two parties"),
        ({"repeat": 0}, "0"),
    ],
)
def test_what_cannot_be_measured_is_refused(asked, message, tmp_path):
    given = {"parties": [2], "names": ["relu"], "protocols": [Protocol()], "out": tmp_path} | asked
    with pytest.raises(ValueError, match=message):
        bench.benchmark(**given)
