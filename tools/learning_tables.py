"""Write the tables of docs/learning.md: short trainings, from the files of reports/learning."""

import csv
from pathlib import Path

from page_tables import rewrite, with_tables

from shaftpose.evaluation.report import pipe_table

ROOT = Path(__file__).parents[1]
PAGE, RECORDS = ROOT / "docs/learning.md", ROOT / "reports/learning"


def main() -> None:
    """Put the tables into the page, between its markers."""
    rewrite(PAGE, page)


def page(text: str) -> str:
    """The page with a table for each file, by the file's name."""
    tables = {path.stem: table(path) for path in sorted(RECORDS.glob("*.csv"))}
    return with_tables(text, tables, "make learning", "docs/learning.md")


def table(path: Path) -> str:
    """A file's rows, its first one as headings."""
    with path.open(newline="") as file:
        headings, *rows = csv.reader(file)
    return pipe_table(headings, rows)


if __name__ == "__main__":
    main()
