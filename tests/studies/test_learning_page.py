"""The documentation shows the recorded trials."""

from pathlib import Path

import pytest

from shaftpose.core.errors import InputError
from studies import learning_tables

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize("name", learning_tables.PAGES)
def test_tables_are_those_of_the_records(name: str) -> None:
    page = (ROOT / name).read_text()
    assert learning_tables.page(page, name) == page, "run `make learning`"


def test_every_record_is_on_a_page() -> None:
    shown = {table for tables in learning_tables.PAGES.values() for table in tables}
    assert shown == {path.stem for path in learning_tables.RECORDS.glob("*.csv")}


def test_a_record_becomes_a_row_for_each_line(tmp_path: Path) -> None:
    path = tmp_path / "round.csv"
    path.write_text('Change,mAP\n"1, 2|3",0.5\n')
    assert learning_tables.table(path).splitlines()[2] == "| 1, 2\\|3 | 0.5 |"


def test_a_page_without_a_records_markers_is_refused() -> None:
    with pytest.raises(
        InputError, match=r"docs/beyond.md: lacks the markers '<!-- \w+: make learning"
    ):
        learning_tables.page("# Page\n", "docs/beyond.md")
