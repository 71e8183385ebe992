"""All files of a report.

OUT/report.html    everything on one page, which loads nothing from elsewhere
OUT/paper.md       the tables in Markdown, for the README
OUT/NAME.png       the figures, for the README; OUT/episodes.png and the animation OUT/episode.gif
"""

from pathlib import Path

from rich.console import Console

from ciphernav_jax.experiments import pictures
from ciphernav_jax.experiments.report import figures, page, results, shown, tables
from ciphernav_jax.experiments.report.results import Results
from ciphernav_jax.navigation.storage import write_text

console = Console(highlight=False)


def run(folder: Path, out: Path) -> None:
    """Read the result files in `folder`, and write the report into `out`.

    Raises:
        FileNotFoundError: no such folder.
        DamagedError: a file is not JSON.
    """
    found = results.load(folder)
    write_text(out / "report.html", page.page(found))
    write_text(out / "paper.md", markdown(found))
    for picture in figures.every(found):
        if picture.draw:
            pictures.save(picture.draw(), out / f"{picture.name}.png")
    for document in found.others.get("episodes", [])[:1]:
        shown.sheet(document, out / "episodes.png")
        frames = list(shown.frames(document["watched"], document["parties"]))
        shown.animation(frames, document["parties"], out / "episode.gif")
    console.print(f"Written: {out}/report.html, {out}/paper.md and pictures")


def markdown(found: Results) -> str:
    """All tables, each as a block that stands in the README between the same comments."""
    return "\n".join(
        f"## {table.title}\n\n<!-- report: {table.name} -->\n{table.markdown()}\n<!-- end -->\n"
        for table in tables.every(found)
    )
