"""Tables in Markdown."""

from collections.abc import Iterable, Sequence


def pipe_table(headings: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table of cells as text."""
    lines = [headings, ["---"] * len(headings), *rows]
    return "\n".join("| " + " | ".join(escape(cell) for cell in line) + " |" for line in lines)


def escape(cell: str) -> str:
    """Text as it stands in a table: a bare `|` would end its cell."""
    return cell.replace("|", "\\|")
