"""The page of a sweep: its best job, table and figures, as one HTML file."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from shaftpose.core.files import new_file
from shaftpose.figures.html_pages import html_template


@dataclass(frozen=True)
class Page:
    """The content of a page.

    best: the name of the best job; rule: why it is the best; command: trains it at full length;
    rows: cells under `headings`, of the best job first; link: to MLflow.
    """

    sweep: str
    best: str
    rule: str
    command: str
    headings: Sequence[str]
    rows: Sequence[Sequence[str]]
    link: str


def write_page(page: Page, pictures: Sequence[Path], path: Path) -> None:
    """Write the page with PNG files, as one file without scripts."""
    # Settings' keys may be broken after their dots, in narrow columns.
    names = [name.replace(".", ".\N{ZERO WIDTH SPACE}") for name in page.headings]
    template = html_template("shaftpose.sweeps", "sweep.html.j2")
    with new_file(path) as part:
        part.write_text(template.render(page=page, names=names, pictures=pictures))
