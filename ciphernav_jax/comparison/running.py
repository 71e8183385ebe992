"""`compare`: one's own function over protocol variants and numbers of parties."""

import itertools
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import Any

from rich.console import Console

from ciphernav_jax import extras, files, provenance, tables
from ciphernav_jax.comparison.results import Comparison
from ciphernav_jax.comparison.rows import Row
from ciphernav_jax.comparison.subject import Subject, subject, words
from ciphernav_jax.comparison.trials import trial
from ciphernav_jax.parties.sharing import require_parties
from ciphernav_jax.protocols import Protocol
from ciphernav_jax.ring import keys

DEFAULT = (Protocol(),)
REMEDY = "choose another folder, or remove it to start anew"

Rows = dict[tuple[str, int], Row]


def compare(
    function: Callable[..., Any],
    *args: Any,
    parties: Sequence[int] = (2, 3, 5),
    protocols: Sequence[Protocol] = DEFAULT,
    public: Sequence[int] = (),
    gradients: bool = True,
    out: str | Path | None = None,
    repeat: int | None = None,
    seed: int = 0,
    progress: bool = True,
) -> Comparison:
    """Evaluates a function with every protocol and every number of parties: what each takes, and gives.

    All of it in this process. A protocol is counted, compiled, timed, and compared with float64, in that
    order. Compile times are those of a process in which the library's own small functions have been traced;
    JAX's persistent compilation cache is off for them, and as before afterwards. An error is that of one
    call, of the same one for the same seed. Secret floats are opened as float64, whatever their dtype. A
    function that does not take its arguments as float64 (one with a float32 carry in a loop) is compared with
    itself in their own dtypes, which the tables say.

    Args:
        function: as for `secure`.
        args: its arguments, pytrees of plain arrays. They are shared with each protocol, all but those in
            `public`.
        parties: numbers of parties.
        protocols: variants; `Protocol.parse("truncation=nearest")` reads one.
        public: numbers of the arguments that stay public.
        gradients: whether gradients are looked at too. Their program takes about as long to compile as the
            function's; a step of training has its gradient among its values already.
        out: a folder. After each row all are written to OUT/comparison.json; the same comparison then goes on
            where it was, and further protocols and parties add to it. What was refused is tried again. At the
            end also comparison.md and comparison.png, which needs matplotlib.
        repeat: timed calls; by default as many as fit in a second, at least 3.
        seed: of all keys, for shares and dealer.
        progress: show a bar; there is none where the output is no terminal.

    Returns:
        A `Comparison`: `print` it, or take its `rows`, `markdown()`, `as_dict()`, `picture(path)`. With `out`
        it has all rows that are there. A variant that is refused, or fails, has a row with the reason.

    Raises:
        What the first variant was refused with, where all were.
        What the function raises on its own.
        ValueError: fewer than two parties; nothing to compare; no call to time; OUT holds a comparison of
            another function, of other arguments, with another seed, or from another machine.
        TypeError: an argument is a `Secret`, or the function is secure already.
        BusyError: another process compares into OUT.
        ModuleNotFoundError: `out` without matplotlib.

    Example:
        >>> import jax.numpy as jnp, numpy as np
        >>> import ciphernav_jax as cn
        >>> def distance(x, y):
        ...     return jnp.sum((x - y) ** 2)
        >>> c = cn.compare(distance, np.ones(4), np.zeros(4), parties=(2, 3), repeat=3)
        >>> [(row.parties, row.rounds, row.failed) for row in c.rows]
        [(2, 2, 0), (3, 2, 0)]
        >>> all(row.error_units < 8 for row in c.rows)
        True
    """
    if not parties or not protocols:
        raise ValueError("there is nothing to compare: give at least one number of parties and one protocol")
    for count in parties:
        require_parties(count)
    if repeat is not None and repeat < 1:
        raise ValueError(f"repeat is a number of calls to time, at least 1, got {repeat}")
    if out is not None:
        extras.require("navigation", "a comparison's picture in `out`", "matplotlib")
        out = Path(out)
    asked = list(itertools.product(dict.fromkeys(parties), dict.fromkeys(protocols)))
    compared = subject(function, args, public, gradients)
    with files.claimed(out) if out else nullcontext(), _bar(progress, len(asked)) as (tell, advance):
        comparison = _compare(compared, asked, out, repeat, seed, tell, advance)
        if out:
            files.write_text(out / "comparison.md", comparison.markdown())
            comparison.picture(out / "comparison.png")
    return comparison


def _compare(
    compared: Subject,
    asked: list[tuple[int, Protocol]],
    out: Path | None,
    repeat: int | None,
    seed: int,
    tell: Callable[[str], None],
    advance: Callable[[], None],
) -> Comparison:
    begun = Comparison(
        (), compared.configuration() | {"seed": seed}, provenance.versions(), provenance.machine()
    )
    path = out and out / "comparison.json"
    rows = _kept(path, begun) if path else {}
    comparison = _with(begun, rows)
    errors = []
    for parties, protocol in asked:
        name, key = f"{protocol}, {parties} parties", (str(protocol), parties)
        if key not in rows or rows[key].refused:
            of_trial = keys.derive(keys.root(seed), "compare", compared.digest, *key)
            try:
                rows[key] = trial(
                    compared,
                    protocol,
                    parties,
                    of_trial,
                    repeat,
                    lambda what, name=name: tell(f"{name}: {what}"),
                )
            except Exception as error:  # the other variants are compared all the same
                errors.append(error)
                rows[key] = Row(str(protocol), parties, protocol.ideal, refused=words(error))
            comparison = _with(begun, rows)
            if path and not all(row.refused for row in rows.values()):  # of a refusal alone nothing is kept
                files.write_json(path, comparison.as_dict())
        advance()
    if len(errors) == len(asked):
        raise errors[0]
    return comparison


def _with(begun: Comparison, rows: Rows) -> Comparison:
    return Comparison(tuple(rows.values()), begun.configuration, begun.versions, begun.machine)


def _kept(path: Path, begun: Comparison) -> Rows:
    """The rows that are there, by protocol and parties.

    Raises:
        DamagedError: the file is not what was written, or is not of this comparison.
    """
    if not path.exists():
        return {}
    with files.fitting(path, REMEDY):
        found = Comparison.from_dict(files.read_json(path, remedy=REMEDY))
        same = {
            "with gradients, or without, and this is the other": found.configuration["gradients"]
            == begun.configuration["gradients"],
            "of another function, or of other arguments": found.configuration["digest"]
            == begun.configuration["digest"],
            "with another seed": found.configuration["seed"] == begun.configuration["seed"],
            "with other versions": found.versions == begun.versions,
            "from another machine": found.machine == begun.machine,
        }
    for how, agrees in same.items():
        if not agrees:
            raise files.DamagedError(f"{path} holds a comparison {how}; {REMEDY}")
    return {(row.protocol, row.parties): row for row in found.rows}


@contextmanager
def _bar(shown: bool, total: int) -> Iterator[tuple[Callable[[str], None], Callable[[], None]]]:
    """A bar on standard error: yields what to tell of the work in hand, and what to call after each row."""
    console = Console(stderr=True)
    with tables.progress(console, shown=shown and console.is_terminal) as bar:
        task = bar.add_task("", total=total)
        yield lambda what: bar.update(task, description=what), lambda: bar.advance(task)
