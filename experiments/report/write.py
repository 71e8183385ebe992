"""All files of a report.

OUT/report.html    everything on one page, which loads nothing from elsewhere
OUT/paper.md       the tables in Markdown, for the README and the pages of docs/results
OUT/NAME.png       the figures, likewise; OUT/episodes.png, OUT/noise.png and the animation OUT/episode.gif
"""

import re
from pathlib import Path

from rich.console import Console

from ciphernav_jax import files
from ciphernav_jax.files import write_bytes, write_png, write_text
from experiments.report import figures, listing, page, results, shown
from experiments.report.figures import DPI
from experiments.report.results import Results

console = Console(highlight=False)


BLOCK = re.compile(r"(?<=<!-- report: )([\w-]+) -->\n(?:.*?\n)??(?=<!-- end -->)", re.DOTALL)
PICTURE = re.compile(r"!\[[^]]*\]\(([^)]+)\)")


def write_report(folder: Path, out: Path, readme: Path | None = None) -> None:
    """Read the result files in `folder`, and write the report into `out`; fill the tables of a `readme`, and
    replace the pictures that it shows.

    Raises:
        FileNotFoundError: no such folder, or no such readme.
        DamagedError: a file is not what was written, or the readme is no text.
        BusyError: another process writes a report into `out`.
        ValueError: the readme has a block of a name that no table has.
    """
    documents = results.read(folder)
    for path, document in documents.items():
        with files.fitting(path):
            _tried(results.gathered({path: document}))
    found = results.gathered(documents)
    text = readme and filled(files.read_text(readme), found)
    with files.claimed(out):
        _write(found, out)
    if readme and text:
        write_text(readme, text)
        for target in PICTURE.findall(text):
            path = readme.parent / target
            if (out / path.name).exists():
                write_bytes(path, (out / path.name).read_bytes())
        console.print(f"Filled: {readme}")


def _tried(alone: Results) -> None:
    """Reads all that the report reads of one document."""
    for table in listing.every(alone):
        table.markdown()
    page.made_with(alone)
    for documents in alone.runs.values():
        figures.episodes_by_length(documents, "success")
    if alone.others:
        page.page(alone)


def _write(found: Results, out: Path) -> None:
    write_text(out / "report.html", page.page(found))
    write_text(out / "paper.md", markdown(found))
    for picture in figures.every(found):
        if picture.draw:
            write_png(out / f"{picture.name}.png", picture.draw(), dpi=DPI)
    for document in found.others.get("episodes", [])[:1]:
        shown.sheet(document, out / "episodes.png")
        frames = list(shown.frames(document["watched"], document["parties"]))
        shown.animation(frames, document["parties"], out / "episode.gif")
        shown.parties(frames[len(frames) // 2], document["parties"], out / "noise.png")
    console.print(f"Written: {out}/report.html, {out}/paper.md and pictures")


def markdown(found: Results) -> str:
    """All tables, each as a block that stands in a page between the same comments."""
    return "\n".join(
        f"## {table.title}\n\n<!-- report: {table.name} -->\n{table.markdown()}\n<!-- end -->\n"
        for table in listing.every(found)
    )


def filled(text: str, found: Results) -> str:
    """A Markdown text with its blocks filled.

    Raises:
        ValueError: a block of a name that no table has.
    """
    blocks = {table.name: table.markdown() for table in listing.every(found)}
    if unknown := [name for name in BLOCK.findall(text) if name not in blocks]:
        raise ValueError(f"no table {', '.join(unknown)}; the tables are {', '.join(blocks)}")
    return BLOCK.sub(lambda block: f"{block[1]} -->\n{blocks[block[1]]}\n", text)
