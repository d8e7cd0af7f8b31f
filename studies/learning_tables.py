"""Write the tables of docs/learning.md: short trainings, from the files of reports/learning."""

import csv
from pathlib import Path

from shaftpose.core.markdown import pipe_table
from studies.page_tables import rewrite, with_tables

ROOT = Path(__file__).parents[1]
PAGE, RECORDS = ROOT / "docs/learning.md", ROOT / "reports/learning"


def main() -> None:
    """Write the tables between the markers of the page."""
    rewrite(PAGE, page)


def page(text: str) -> str:
    """The page with one table for each file, named after it."""
    tables = {path.stem: table(path) for path in sorted(RECORDS.glob("*.csv"))}
    return with_tables(text, tables, "make learning", "docs/learning.md")


def table(path: Path) -> str:
    """A file's rows as a table, the first as headings."""
    with path.open(newline="") as file:
        headings, *rows = csv.reader(file)
    return pipe_table(headings, rows)


if __name__ == "__main__":
    main()
