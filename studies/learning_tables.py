"""Write the tables of what was tried, in docs, from the files of reports/learning."""

import csv
from functools import partial
from pathlib import Path

from shaftpose.core.errors import exit_on_input_error
from shaftpose.figures.markdown import pipe_table
from studies.pages import rewrite, with_tables

ROOT = Path(__file__).parents[1]
RECORDS = ROOT / "reports/learning"
PAGES = {
    "docs/learning.md": ("first_round", "second_round", "dense"),
    "docs/beyond.md": ("held", "edges", "offsets", "readers", "capacity", "only_mask", "fit"),
    "docs/real_images.md": ("real",),
}


def main() -> None:
    """Write the tables between the markers of the pages."""
    with exit_on_input_error():
        for name in PAGES:
            rewrite(ROOT / name, partial(page, name=name))


def page(text: str, name: str) -> str:
    """A page with one table for each of its files, named after it."""
    tables = {stem: table(RECORDS / f"{stem}.csv") for stem in PAGES[name]}
    return with_tables(text, tables, "make learning", name)


def table(path: Path) -> str:
    """A file's rows as a table, the first as headings."""
    with path.open(newline="") as file:
        headings, *rows = csv.reader(file)
    return pipe_table(headings, rows)


if __name__ == "__main__":
    main()
