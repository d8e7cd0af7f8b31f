"""docs/learning.md shows the recorded trials."""

from pathlib import Path

import pytest

from shaftpose.errors import InputError
from studies import learning_tables

ROOT = Path(__file__).parents[2]

PAGE = (ROOT / "docs/learning.md").read_text()


def test_tables_are_those_of_the_records() -> None:
    assert learning_tables.page(PAGE) == PAGE, "run `make learning`"


def test_a_record_becomes_a_row_for_each_line(tmp_path: Path) -> None:
    path = tmp_path / "round.csv"
    path.write_text('Change,mAP\n"1, 2|3",0.5\n')
    assert learning_tables.table(path).splitlines()[2] == "| 1, 2\\|3 | 0.5 |"


def test_a_page_without_a_records_markers_is_refused() -> None:
    with pytest.raises(InputError, match=r"docs/learning.md: lacks the markers '<!-- dense"):
        learning_tables.page("# Page\n")
