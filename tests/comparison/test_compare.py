"""What `cn.compare` promises: numbers that others find too, rows for what is refused, a file that grows."""

import inspect
import io
import itertools
import json
import math
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from matplotlib.image import imread
from rich.console import Console

import ciphernav_jax as cn
from ciphernav_jax import extras, files
from ciphernav_jax.comparison import Comparison, Row, pictures, running, timing, trials
from ciphernav_jax.ring import keys

pytestmark = pytest.mark.slow

DEFAULT = cn.Protocol()
LOCAL = cn.Protocol(truncation="local")
NEAREST = cn.Protocol(truncation="nearest")
IDEAL = cn.Protocol(multiplication="ideal", truncation="ideal", comparison="ideal")
UNIT = 2.0**-20

# Products of 2 million, half of what fits: a local truncation of one fails with probability 2e6 * 2^-24.
X = np.random.default_rng(0).uniform(1400, 1430, 300)
W = np.random.default_rng(1).uniform(1400, 1430, 300)
SHIFT = np.array(0.25)


def shifted(x, w, shift):
    return {"y": x * w - jnp.exp(shift), "shift": jnp.exp(shift)}


def total(x, w):
    result = shifted(x, w, SHIFT)
    return jnp.sum(result["y"])


@pytest.fixture(scope="module")
def compared():
    given = {"public": (2,), "seed": 3, "repeat": 4, "progress": False}
    found = cn.compare(shifted, X, W, SHIFT, parties=(2, 3), protocols=(DEFAULT, LOCAL, IDEAL), **given)
    exact = cn.compare(shifted, X, W, SHIFT, parties=(2,), protocols=[NEAREST], **given)
    return found, {(row.protocol, row.parties): row for row in (*found.rows, *exact.rows)}


def shared(protocol, parties):
    return cn.share(jax.random.key(5), (X, W), parties=parties, protocol=protocol)


def test_there_is_a_row_for_each_in_the_order_asked(compared):
    protocols = ["default", "truncation=local", str(IDEAL)]
    assert [(row.protocol, row.parties) for row in compared[0].rows] == [
        (protocol, parties) for parties in (2, 3) for protocol in protocols
    ]


@pytest.mark.parametrize(("protocol", "parties"), [(DEFAULT, 2), (DEFAULT, 3), (NEAREST, 2)])
def test_rounds_and_bytes_are_those_of_cost(compared, protocol, parties):
    expected = cn.cost(cn.secure(shifted, protocol=protocol), *shared(protocol, parties), SHIFT)
    row = compared[1][str(protocol), parties]
    assert (row.rounds, row.bytes_sent, row.bytes_dealt, row.unbounded) == (
        expected.rounds,
        expected.bytes_sent,
        expected.bytes_dealt,
        False,
    )
    assert (row.lan_seconds, row.wan_seconds) == (expected.seconds(cn.LAN), expected.seconds(cn.WAN))


def test_errors_are_those_of_what_is_revealed(compared):
    """Truncation to the nearest rounds in the same way whatever the keys: any other call has these errors."""
    secrets = shared(NEAREST, 2)
    y = cn.reveal(cn.secure(shifted, protocol=NEAREST)(jax.random.key(6), *secrets, SHIFT))["y"]
    row = compared[1][str(NEAREST), 2]
    assert row.error == np.max(np.abs(y - (X * W - np.exp(SHIFT)))) > 0
    assert row.error_units == row.error / UNIT
    gradients = cn.secure(jax.grad(total, argnums=(0, 1)), protocol=NEAREST)(jax.random.key(7), *secrets)
    off = [np.max(np.abs(g - e)) for g, e in zip(cn.reveal(gradients), (W, X), strict=True)]
    assert row.gradient_error == max(off) > 0
    assert row.gradient_error_units == row.gradient_error / UNIT


def test_float32_results_are_looked_at_as_the_fixed_point_they_are():
    # A float32 of two million is off by up to an eighth.
    narrow = X[:2].astype(np.float32)
    (row,) = cn.compare(lambda x: x * x, narrow, parties=(2,), protocols=[IDEAL], repeat=1).rows
    assert row.error_units < 1430


def test_truncations_that_fail_are_counted(compared):
    rows = compared[1]
    local = rows[str(LOCAL), 2]
    assert local.truncations == rows["default", 2].truncations == 300
    assert 10 < local.failed < 90
    assert local.error > 1e6
    for (protocol, _), row in rows.items():
        if protocol != str(LOCAL):
            assert row.failed == 0
            assert row.error_units < 2000


def test_ideal_variants_are_marked_and_have_no_projection(compared):
    row = compared[1][str(IDEAL), 3]
    assert row.ideal
    assert row.lan_seconds is row.wan_seconds is None
    assert not compared[1]["default", 3].ideal
    assert "(ideal: not a protocol)" in compared[0].markdown()


def test_a_variant_that_refuses_has_a_reason_and_no_numbers(compared):
    row = compared[1][str(LOCAL), 3]
    assert "local truncation is for two parties" in row.refused
    assert row == Row(str(LOCAL), 3, False, refused=row.refused)
    assert f"truncation=local, 3 parties: {row.refused}" in compared[0].markdown()
    assert "local truncation is for two parties" in str(compared[0])


def test_times_calls_and_memory_are_told(compared):
    for row in compared[0].rows:
        if not row.refused:
            assert row.calls == 4
            assert 0 < row.seconds < row.compile_seconds
            # Shares of two arguments and of two results, and no more than a few times as much.
            entries = row.parties * 4 * 8 * X.size
            assert entries < row.memory_bytes < 100 * entries


def test_calls_fill_about_a_second_and_have_a_key_each(monkeypatch):
    given, clock = [], itertools.count(0.0, 0.1)  # a call takes a tenth of a second
    monkeypatch.setattr(timing.time, "perf_counter", lambda: next(clock))

    def taken(repeat=None, **so_long):
        given.clear()
        run = lambda key, x: given.append(np.asarray(keys.words(key)).tobytes())  # noqa: E731
        times = [seconds for seconds, _ in timing.calls(run, keys.root(0), (1,), repeat, **so_long)]
        np.testing.assert_allclose(times, 0.1)
        assert len(set(given)) == len(given) == len(times)
        return len(times)

    assert taken(seconds=0.95, fewest=3) == 10
    assert taken(seconds=0.0, fewest=3) == 3
    assert taken(seconds=1e9, fewest=3) == timing.MOST
    assert taken(2, seconds=1.0, fewest=3) == 2


@pytest.mark.parametrize(
    ("found", "expected", "error"),
    [
        ([1.0, 2.5], [1.0, 2.0], 0.5),
        ([np.nan], [1.0], math.inf),
        ([1.0], [np.nan], math.inf),
        ([np.nan, np.inf], [np.nan, np.inf], 0.0),
        ([], [], 0.0),
    ],
)
def test_what_is_no_number_is_infinitely_far_from_one(found, expected, error):
    assert trials.largest_error([np.array(found)], [np.array(expected)]) == error


def test_a_function_of_integers_has_no_gradient():
    def largest(x):
        return jnp.argmax(x)

    found = cn.compare(largest, np.array([1.0, 3.0]), parties=(2,), protocols=[IDEAL], repeat=1)
    (row,) = found.rows
    assert (row.error, row.gradient_error, row.no_gradient) == (0, None, "no result is a float")
    assert "No gradient: no result is a float." in found.markdown()


def test_gradients_may_be_left_out():
    found = cn.compare(lambda x: x * x, X[:2], parties=(2,), protocols=[IDEAL], gradients=False, repeat=1)
    (row,) = found.rows
    assert (row.gradient_error, row.no_gradient) == (None, "it was not asked for")
    assert "No gradient: it was not asked for." in found.markdown()
    assert [axes.get_title(loc="left") for axes in pictures.figure([row], "f").axes[2:]] == [
        "Largest error of a value"
    ]


def test_a_function_refused_for_all_raises_with_its_own_line():
    line = inspect.getsourcelines(shifted)[1] + 1
    with pytest.raises(NotImplementedError, match=rf"`exp` .*test_compare.py:{line} \(shifted\)"):
        cn.compare(shifted, X, W, SHIFT, parties=(2, 3))


def test_a_gradient_without_a_rule_is_a_reason():
    @jax.custom_jvp
    def doubled(x):
        return 2 * x

    doubled.defjvp(lambda x, t: (2 * x[0], jnp.exp(x[0]) * t[0]))
    (row,) = cn.compare(doubled, np.ones(2), parties=(2,), repeat=1).rows
    assert row.error == 0
    assert row.gradient_error is None
    assert "`exp`" in row.no_gradient


# --- what is written ----------------------------------------------------------------------------------


@pytest.fixture
def instant(monkeypatch):
    """Trials that are not run: each is noted, and answers the same."""
    tried = []

    def trial(subject, protocol, parties, key, repeat, tell):
        tell("pretending")
        tried.append((str(protocol), parties))
        if protocol.truncation == "local" and parties > 2:
            raise ValueError("two parties only")
        if protocol.frac_bits == 30:
            raise RuntimeError("out of\nmemory")
        return Row(
            str(protocol), parties, protocol.ideal, seconds=0.25 * parties, error=math.inf, wan_seconds=2.0
        )

    monkeypatch.setattr(running, "trial", trial)
    return tried


def square(x):
    return x * x


def swept(out, *protocols, parties=(2, 3), function=square, x=3.0, **given):
    return cn.compare(function, np.array(x), parties=parties, protocols=protocols, out=out, **given)


def test_what_is_there_is_kept(instant, tmp_path):
    first = swept(tmp_path, DEFAULT, NEAREST)
    assert len(instant) == 4
    written = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    assert set(written) == {"comparison.json", "comparison.md", "comparison.png"}
    assert swept(tmp_path, DEFAULT, NEAREST) == first
    assert len(instant) == 4
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == written
    more = swept(tmp_path, IDEAL, DEFAULT, parties=(2,))
    assert instant[4:] == [(str(IDEAL), 2)]
    assert more.rows[:4] == first.rows
    assert len(more.rows) == 5


def test_it_goes_on_where_it_was_killed(instant, tmp_path, monkeypatch):
    trial = running.trial

    def killed(subject, protocol, parties, *rest):
        if parties == 3:
            raise KeyboardInterrupt
        return trial(subject, protocol, parties, *rest)

    monkeypatch.setattr(running, "trial", killed)
    with pytest.raises(KeyboardInterrupt):
        swept(tmp_path, DEFAULT)
    kept = Comparison.from_dict(files.read_json(tmp_path / "comparison.json"))
    assert [row.parties for row in kept.rows] == [2]
    monkeypatch.setattr(running, "trial", trial)
    assert [row.parties for row in swept(tmp_path, DEFAULT).rows] == [2, 3]
    assert instant == [("default", 2), ("default", 3)]


def test_what_failed_has_a_row_and_is_tried_again(instant, tmp_path):
    found = swept(tmp_path, LOCAL, cn.Protocol(frac_bits=30), DEFAULT)
    assert [row.refused for row in found.rows if row.parties == 3] == [
        "two parties only",
        "RuntimeError: out of memory",
        "",
    ]
    before = (tmp_path / "comparison.json").read_bytes()
    instant.clear()
    swept(tmp_path, LOCAL, cn.Protocol(frac_bits=30), DEFAULT)
    assert instant == [("frac_bits=30", 2), ("truncation=local", 3), ("frac_bits=30", 3)]
    assert (tmp_path / "comparison.json").read_bytes() == before


def test_of_a_refusal_alone_nothing_is_kept(instant, tmp_path):
    with pytest.raises(ValueError, match="two parties only"):
        swept(tmp_path, LOCAL, parties=(3, 5))
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("given", "what"),
    [
        ({"function": lambda x: x + x}, "of another function, or of other arguments"),
        ({"x": 4.0}, "of another function, or of other arguments"),
        ({"seed": 1}, "with another seed"),
        ({"gradients": False}, "with gradients, or without, and this is the other"),
    ],
)
def test_another_comparison_is_refused_with_the_way_out(instant, tmp_path, given, what):
    swept(tmp_path, DEFAULT)
    before = (tmp_path / "comparison.json").read_bytes()
    with pytest.raises(ValueError, match=f"{what}; choose another folder, or remove it"):
        swept(tmp_path, DEFAULT, **given)
    assert (tmp_path / "comparison.json").read_bytes() == before


def test_another_machine_is_refused(instant, tmp_path, monkeypatch):
    swept(tmp_path, DEFAULT)
    monkeypatch.setattr(running.provenance, "machine", lambda: {"cpus": 99, "processor": "another"})
    with pytest.raises(ValueError, match="from another machine"):
        swept(tmp_path, DEFAULT)


def test_a_folder_has_one_writer(instant, tmp_path):
    with files.claimed(tmp_path), pytest.raises(files.BusyError):
        swept(tmp_path, DEFAULT)


def test_a_damaged_file_is_named(instant, tmp_path):
    swept(tmp_path, DEFAULT)
    path = tmp_path / "comparison.json"
    path.write_text(path.read_text().replace('"parties": 2', '"parties": 4'))
    with pytest.raises(files.DamagedError, match=r"comparison.json is not what was written"):
        swept(tmp_path, DEFAULT)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"parties": (1,)}, "two parties"),
        ({"parties": ()}, "nothing to compare"),
        ({"protocols": ()}, "nothing to compare"),
        ({"repeat": 0}, "at least 1"),
    ],
)
def test_what_cannot_be_compared_is_refused(instant, given, message):
    with pytest.raises(ValueError, match=message):
        cn.compare(square, np.ones(1), **given)
    assert instant == []


def test_a_missing_matplotlib_is_said_before_anything_is_run(instant, tmp_path, monkeypatch):
    monkeypatch.setattr(extras, "missing", lambda extra: ["miniworld"])
    swept(tmp_path, DEFAULT, parties=(2,))
    monkeypatch.setattr(extras, "missing", lambda extra: ["matplotlib"])
    with pytest.raises(ModuleNotFoundError, match=r"matplotlib: pip install 'ciphernav_jax\[navigation\]'"):
        swept(tmp_path, DEFAULT)
    assert len(instant) == 1
    found = cn.compare(square, np.ones(1), parties=(2,))
    with pytest.raises(ModuleNotFoundError, match="the picture of a comparison needs matplotlib"):
        found.picture(tmp_path / "a.png")


def test_where_the_output_is_no_terminal_there_is_no_bar(instant, capsys):
    cn.compare(square, np.ones(1), parties=(2,))
    assert capsys.readouterr() == ("", "")


def test_dicts_and_markdown_hold_everything(compared):
    found = compared[0]
    unknown = replace(found, rows=(*found.rows, Row("adder=ripple", 2, False, error=math.inf)))
    for comparison in (found, unknown):
        document = json.loads(json.dumps(comparison.as_dict(), allow_nan=False))
        assert Comparison.from_dict(document) == comparison
    row = compared[1]["default", 2]
    shown = found.markdown()
    assert f"| default | 2 | {1e3 * row.seconds:.3g} | " in shown
    assert f" | {row.rounds} | {row.bytes_sent:,} | {row.bytes_dealt:,} | " in shown
    assert f" | {row.error:.1e} | " in shown
    assert shown.startswith(f"shifted on {found.machine['cpus']} cores of {found.machine['processor']}")
    assert found.configuration["arguments"]["args[0]"] == "float64[300]"
    assert found.configuration["public"] == [2]
    assert found.versions["jax"] == jax.__version__
    assert max(map(len, str(found).splitlines())) <= 110


def test_tables_fit_a_terminal(compared):
    told = io.StringIO()
    Console(file=told, width=80).print(compared[0])
    shown = told.getvalue()
    assert shown.count("variant") == 3
    assert "…" not in shown


# --- the picture --------------------------------------------------------------------------------------


def test_a_picture_is_written(compared, tmp_path):
    compared[0].picture(tmp_path / "a.png")
    height, width, _ = imread(tmp_path / "a.png").shape
    assert min(height, width) > 500
    assert [path.name for path in tmp_path.iterdir()] == ["a.png"]


@pytest.mark.parametrize("parties", [(2,), (2, 3, 5)])
@pytest.mark.parametrize("count", [1, 6, 20])
def test_no_mark_hides_another(parties, count):
    """All variants have the same numbers, and every mark has a place of its own in its panel."""
    same = {"seconds": 0.5, "wan_seconds": 2.0, "error": 1e-6, "gradient_error": 1e-5}
    rows = [Row(f"frac_bits={i}", p, i == 2, **same) for p in parties for i in range(count)]
    figure = pictures.figure(rows, "the same")
    assert len(figure.axes) == 4
    for axes in figure.axes:
        marks = [line for line in axes.lines if line.get_marker() != "None"]
        places = {tuple(float(np.asarray(v)[0]) for v in line.get_data()) for line in marks}
        assert len(places) == len(marks) == len(rows)


def test_what_has_no_number_is_said_in_the_picture():
    rows = [
        Row("default", 2, False, seconds=1.0, error=0.0, no_gradient="no result is a float"),
        Row("truncation=local", 3, False, refused="two parties only"),
        Row("frac_bits=30", 2, False, seconds=1.0, error=math.inf, gradient_error=1e-5),
    ]
    values, gradients = pictures.figure(rows, "f").axes[2:]
    assert [text.get_text() for text in values.texts] == [
        "P = 2: exact",
        "P = 3: refused",
        "P = 2: not a number",
    ]
    assert [text.get_text().strip() for text in gradients.texts] == ["P = 2: none", "P = 3: refused", "P = 2"]
