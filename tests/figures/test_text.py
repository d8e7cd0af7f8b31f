"""Text for a terminal."""

from shaftpose.figures.text import aligned


def test_columns_are_as_wide_as_their_longest_cell() -> None:
    assert aligned(["a", "long"], [["wide", "1"], ["b", ""]]) == "a     long\nwide  1\nb"
