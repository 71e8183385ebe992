import io
import math

from rich.console import Console

from ciphernav_jax.navigation import metrics


def half(trials, success, efficient=0, obstacle=0, wall=0, no_crash=0):
    return {
        "trials": trials,
        "success": success,
        "efficient": efficient,
        "crash_obstacle": obstacle,
        "crash_wall": wall,
        "no_crash": no_crash,
    }


COUNTS = {"detour": half(10, 5, 4, 3, 2, 0), "no_detour": half(30, 30, 27)}


def test_overall_is_derived_from_counts_not_from_the_halves_percentages():
    both = metrics.overall(COUNTS)
    assert both == half(40, 35, 31, 3, 2, 0)
    assert metrics.accuracy(both) == 87.5


def test_nothing_of_nothing_is_not_a_number():
    assert math.isnan(metrics.percent(0, 0))


def test_markdown_stands_beside_the_paper():
    text = metrics.table({"secret-2": COUNTS, "plaintext-classifier": COUNTS}).markdown()
    assert (
        "| 2 parties, cameras | 50.0 (93.6) | 100.0 (98.8) | 87.5 (96.6) | 88.6 (99.5) | 3 / 2 / 0 |" in text
    )
    assert "| Plaintext, the secret recipe | 50.0 | 100.0 | 87.5 | 88.6 | 3 / 2 / 0 |" in text


def test_a_party_count_that_the_paper_has_not_gets_a_row_too():
    assert metrics.rows({"secret-3": COUNTS})[0][:2] == ("3 parties, cameras", "50.0")


def test_one_seed_of_a_row_stands_beside_the_paper_too():
    (title, *cells), (whole, *same) = metrics.rows({"secret-2, seed 7": COUNTS, "secret-2": COUNTS})
    assert title == f"{whole}, seed 7"
    assert cells == same


def test_the_terminal_shows_the_same_cells():
    terminal = io.StringIO()
    Console(file=terminal, width=200).print(metrics.table({"secret-2": COUNTS}, "heading"))
    shown = terminal.getvalue()
    assert all(cell in shown for cell in metrics.rows({"secret-2": COUNTS})[0])
