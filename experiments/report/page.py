"""The page: one file that loads nothing from elsewhere, and can be read on a phone, in light and in dark."""

import html
import itertools
import json
import re
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import NamedTuple

from ciphernav_jax.navigation import paper
from ciphernav_jax.navigation.owners import SLOTS, cast
from ciphernav_jax.tables import Cells
from experiments.report import figures, listing, shown
from experiments.report.figures import Picture
from experiments.report.results import Document, Results, overall_accuracy, spread, truncations
from experiments.report.table import Table, duration, script, title

HERE = Path(__file__).parent
TITLE = "Private multiparty perception for navigation, in JAX"
INTRODUCTION = (
    "Cameras and a robot belong to parties who do not trust one another; a small network, trained and "
    "evaluated under secret sharing, tells the robot its next move and nobody anything else. Below stands "
    "what `ciphernav_jax` measured beside what the paper prints: *Private Multiparty Perception for "
    "Navigation*, Lu, Chiquier, Vondrick, NeurIPS 2022. It is a simulation: all parties and the dealer run "
    "on one machine. Every number comes from the JSON files in `results`."
)


class Section(NamedTuple):
    """A part of the page: the names of its tables and figures."""

    name: str
    title: str
    text: str
    parts: tuple[str, ...]


SECTIONS = (
    Section(
        "parties",
        "What each party sees",
        "Each party encodes its own views, framed here, and shares their features. What it holds of the "
        "others' is noise: one sees the highest byte of each word of its share. Cameras share once, since "
        "the world stands still; the robot shares at every step. Only its next action is opened.",
        ("player",),
    ),
    Section(
        "accuracy",
        "Accuracy",
        "The robot starts in a corner, and must stop on its goal without touching a wall or an obstacle. "
        "Half of the episodes require a detour around an obstacle, which is on no map.",
        ("overall", "accuracy-test", "accuracy-unseen", "bounds", "beyond"),
    ),
    Section(
        "cost",
        "Cost",
        "The paper trains the classifier under secret sharing for days. What it takes here:",
        ("cost", "curves", "paper-recipe", "messages", "truncations", "forward"),
    ),
    Section(
        "paths",
        "Failures and path lengths",
        "How failed episodes ended, how good the paths are, and what their length does.",
        (
            *("success-by-length", "failure-by-length"),
            *("failures-test", "failures-unseen", "efficiency-test", "efficiency-unseen"),
        ),
    ),
    Section(
        "episodes",
        "Episodes",
        "From above: the goal is green, cameras stand in the corners; below each the four cameras' views. "
        "The longest of each kind, in different layouts.",
        ("episodes",),
    ),
    Section(
        "attacks",
        "Attacks",
        "Attackers try to tell from what parties see what they should not know.",
        ("reconstruction", "own_runs", "queries"),
    ),
    Section(
        "engine",
        "The engine",
        "The paper's action classifier beside the machine's floor, other frameworks, and variants of the "
        "protocols.",
        ("bench", "growth", "peers", "variants", "sweep", "trained"),
    ),
)


def page(results: Results) -> str:
    """The whole page."""
    parts = {table.name: _table(table) for table in listing.every(results)}
    parts |= {picture.name: _figure(picture) for picture in figures.every(results)}
    parts |= {"player": _player(results), "episodes": _episodes(results)}
    links = "".join(f'<a href="#{section.name}">{section.title}</a>' for section in SECTIONS)
    body = "\n".join(_section(section, parts) for section in SECTIONS)
    return f"""<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{TITLE}</title>
<link rel="icon" href="data:,">
<style>
{(HERE / "page.css").read_text()}</style>
</head>
<body>
<h1>{TITLE}</h1>
<p>{rich(INTRODUCTION)}</p>
<div class="tiles">{"".join(_tile(*tile) for tile in tiles(results))}</div>
<nav>{links}</nav>
{body}
<footer><h2>Made with</h2>{made_with(results)}</footer>
</body>
</html>
"""


def tiles(results: Results) -> Iterator[tuple[str, str]]:
    """The main numbers, each with what it is."""
    for name in ("secret-2", "secret-5"):
        if documents := results.runs.get(name):
            ours = spread(documents, overall_accuracy).text()
            yield (
                f"{ours} %",
                f"accuracy, {title(name)}; the paper {paper.TABLE[name].overall:g}\u00a0%",
            )
    for name in ("secret-2", "fewest-2"):
        if documents := results.runs.get(name):
            seconds = spread(documents, lambda document: document["seconds"]["train"]).mean
            accuracy = spread(documents, overall_accuracy).text()
            yield (
                duration(seconds),
                f"of training in secret from scratch, {title(name)}: {accuracy}\u00a0%; the paper "
                f"{duration(paper.TRAINING_S)} on a GPU",
            )
    carried, failed = truncations([document for documents in results.runs.values() for document in documents])
    if carried:
        yield f"{failed:,}", f"of {carried:,} truncations failed in all secret trainings"


def _tile(number: str, what: str) -> str:
    return f'<div class="tile"><b>{number}</b><small>{html.escape(what)}</small></div>'


def rich(text: str) -> str:
    """HTML of a text with `code` and *emphasis*."""
    text = re.sub(r"`([^`]+)`", r"<code>\1</code>", html.escape(text, quote=False))
    return re.sub(r"\*([^*]+)\*", r"<em>\1</em>", text)


def _section(section: Section, parts: dict[str, str]) -> str:
    head = f'<h2 id="{section.name}">{section.title}</h2>\n<p>{rich(section.text)}</p>'
    return f"<section>{head}\n{_flowing(section.parts, parts)}</section>"


def _flowing(names: Iterable[str], parts: dict[str, str]) -> str:
    """Parts one below the other, neighbouring figures side by side."""
    found = []
    for is_figure, group in itertools.groupby(
        map(parts.__getitem__, names), lambda part: part.startswith("<figure")
    ):
        joined = "\n".join(group)
        found.append(f'<div class="figures">{joined}</div>' if is_figure else joined)
    return "\n".join(found)


def _table(table: Table) -> str:
    shown = ""
    if table.rows:
        classes = _classes(table.header)
        rows = "\n".join(_row(row, classes) for row in table.rows)
        shown = (
            f'<div class="scroll" tabindex="0" role="region" aria-label="{html.escape(table.title)}"><table>'
            f"<thead>{_head(table.header)}</thead>\n<tbody>{rows}</tbody></table></div>\n"
            f'<p class="note">{rich(table.note)}</p>'
        )
    return f"<h3>{html.escape(table.title)}</h3>\n{shown}{_missing(table.missing)}"


def _groups(header: Cells) -> list[tuple[str, list[str]]]:
    """Neighbouring columns "group: column" together; a column without a group is one."""
    split = [
        (group, column) if column else ("", group) for group, _, column in (h.partition(": ") for h in header)
    ]
    found = []
    for (group, _), columns in itertools.groupby(
        enumerate(split), lambda item: (item[1][0], not item[1][0] and item[0])
    ):
        found.append((group, [column for _, (_, column) in columns]))
    return found


def _head(header: Cells) -> str:
    upper, lower = [], []
    for group, columns in _groups(header):
        if group:
            upper.append(f'<th colspan="{len(columns)}">{html.escape(group)}</th>')
            lower += [f"<th>{html.escape(column)}</th>" for column in columns]
        else:
            upper.append(f'<th rowspan="2">{html.escape(columns[0])}</th>')
    return f"<tr>{''.join(upper)}</tr><tr>{''.join(lower)}</tr>"


def _classes(header: Cells) -> list[str]:
    """Of each column: where a group begins, and whether the numbers are the paper's."""
    return [
        " ".join(["first"] * bool(group and not i) + ["paper"] * ("paper" in (group, column)))
        for group, columns in _groups(header)
        for i, column in enumerate(columns)
    ]


def _row(row: Cells, classes: list[str]) -> str:
    first, *others = (html.escape(cell) for cell in row)
    cells = "".join(
        f'<td class="{of}">{cell}</td>' if of else f"<td>{cell}</td>"
        for cell, of in zip(others, classes[1:], strict=True)
    )
    return f'<tr><th scope="row">{first}</th>{cells}</tr>'


def _figure(picture: Picture) -> str:
    drawn = f"<h3>{html.escape(picture.title)}</h3>{figures.svg(picture) if picture.draw else ''}"
    said = f"<figcaption>{rich(picture.note)}</figcaption>{_missing(picture.missing)}"
    return f"<figure{' class=wide' * picture.wide}>{drawn}{said}</figure>"


def _missing(commands: Iterable[str]) -> str:
    return "".join(
        f'<p class="missing">Missing here; made by <code>{command}</code></p>' for command in commands
    )


def _player(results: Results) -> str:
    """One episode step by step. Without JavaScript its last step stands there."""
    documents = results.others.get("episodes")
    if not documents:
        return _missing([script("episodes")])
    document = documents[0]
    parties = cast(document["parties"])
    frames = list(shown.frames(document["watched"], document["parties"]))
    sources = [{name: shown.uri(image) for name, image in _images(frame)} for frame in frames]
    changing = [name for name in sources[0] if len({source[name] for source in sources}) > 1]
    steps = {
        "frames": [{name: source[name] for name in changing} for source in sources],
        "captions": [frame.caption for frame in frames],
    }
    rows = ['<span class="corner"></span>', *(f"<span>{shown.HEADINGS[slot]}</span>" for slot in SLOTS)]
    for number, party in enumerate(parties):
        rows.append(f'<span class="who">{shown.name(party)}</span>')
        for slot in SLOTS:
            own, what = slot in party.slots, shown.HEADINGS[slot]
            style = " ".join(["own"] * own + ["square"] * (own and slot == "map"))
            text = f"{what}, in the clear" if own else f"share of {what}: noise"
            rows.append(_image(f"{number}-{slot}", sources[-1][f"{number}-{slot}"], text, style))
    return f"""<div class="player">
<div>{_image("truth", sources[-1]["truth"], "the world from above, with the path so far")}
<p aria-live="off">{frames[-1].caption}</p>
<div class="controls" hidden><button type="button">Pause</button>
<input type="range" min="0" max="{len(frames) - 1}" value="{len(frames) - 1}" aria-label="step"></div>
<p class="note">From above, as nobody sees it. {_driver(document)}</p></div>
<div class="grid">{"".join(rows)}</div>
<script type="application/json">{json.dumps(steps)}</script>
</div>
<script>
{(HERE / "player.js").read_text()}</script>"""


def _images(frame: shown.Frame) -> Iterator[tuple[str, shown.Pixels]]:
    yield "truth", frame.truth
    for (number, slot), image in frame.tiles.items():
        yield f"{number}-{slot}", image


def _image(name: str, source: str, text: str, style: str = "") -> str:
    return f'<img data-name="{name}" class="{style}" alt="{text}" src="{source}">'


def _episodes(results: Results) -> str:
    documents = results.others.get("episodes")
    if not documents:
        return _missing([script("episodes")])
    found = []
    for kind, episodes in documents[0]["episodes"].items():
        drawn = "".join(map(_episode, episodes))
        drawn = f'<div class="episodes">{drawn}</div>' if drawn else "<p>There is none in the test set.</p>"
        found.append(f"<h3>{kind.capitalize()}</h3>{drawn}")
    return "\n".join([*found, f'<p class="note">{_driver(documents[0])}</p>'])


def _driver(document: Document) -> str:
    return f"{title(document['driver'])}, seed {document['seed']}."


def _episode(episode: Document) -> str:
    views = "".join(
        f'<img alt="camera {shown.HEADINGS[camera]}" src="data:image/png;base64,{view}">'
        for camera, view in episode["views"].items()
    )
    text = shown.caption(episode)
    return (
        f'<figure><img alt="from above" src="{shown.uri(shown.drawn(episode))}">'
        f'<div class="views">{views}</div><figcaption>{text}</figcaption></figure>'
    )


def made_with(results: Results) -> str:
    """Machines and versions of all documents."""
    made = {
        (f"{d['machine']['cpus']} cores of {d['machine']['processor']}", *sorted(d["versions"].items()))
        for d in results.documents()
    }
    return "".join(
        f"<p class=note>{machine}; {', '.join(f'{name} {version}' for name, version in versions)}</p>"
        for machine, *versions in sorted(made)
    )
