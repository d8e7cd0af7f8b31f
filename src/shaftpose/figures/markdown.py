"""Text and tables in Markdown."""

import html
import re
from collections.abc import Iterable, Sequence

# Underscores within a word are no markup.
_MARKUP = re.compile(r"[\\`*\[\]~]|(?<![^\W_])_|_(?![^\W_])")


def pipe_table(headings: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table of cells in Markdown; a bare `|`, which would end its cell, is escaped."""
    lines = [headings, ["---"] * len(headings), *rows]
    return "\n".join(
        "| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |" for line in lines
    )


def escape(text: str) -> str:
    """One line of Markdown that shows plain text unchanged, also in renderers that accept HTML
    tags."""
    return _MARKUP.sub(r"\\\g<0>", html.escape(" ".join(text.split()), quote=False))
