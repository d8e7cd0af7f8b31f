"""The page of a sweep: its best job, table and figures, as one HTML file."""

from base64 import b64encode
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import resources
from pathlib import Path

from jinja2 import Environment, StrictUndefined

from shaftpose.core.files import new_file


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
    template = resources.files("shaftpose.sweeps").joinpath("sweep.html.j2").read_text("utf-8")
    environment = Environment(
        autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    environment.filters |= {"embedded": _embedded, "breakable": _breakable}
    with new_file(path) as part:
        part.write_text(environment.from_string(template).render(page=page, pictures=pictures))


def _embedded(picture: Path) -> str:
    return f"data:image/png;base64,{b64encode(picture.read_bytes()).decode('ascii')}"


def _breakable(key: str) -> str:
    """A setting's key that may be broken after its dots, in narrow columns."""
    return key.replace(".", ".\N{ZERO WIDTH SPACE}")
