"""Tables between their markers."""

import pytest

from shaftpose.core.errors import InputError
from studies.pages import with_tables

PAGE = "before\n<!-- a: make a -->\n\nold\n\n<!-- end of a -->\nafter\n"


def test_a_table_is_replaced_and_the_rest_stays() -> None:
    assert with_tables(PAGE, {"a": "new"}, "make a", "page.md") == PAGE.replace("old", "new")


@pytest.mark.parametrize("text", ["", "<!-- end of a -->\n<!-- a: make a -->\n"])
def test_a_page_without_markers_or_in_another_order_is_refused(text: str) -> None:
    with pytest.raises(InputError, match="page.md: lacks the markers '<!-- a: make a -->'"):
        with_tables(text, {"a": "new"}, "make a", "page.md")
