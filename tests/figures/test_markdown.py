"""Markdown that shows text as it is."""

import html

import pytest
from markdown_it import MarkdownIt

from shaftpose.figures.markdown import escape, pipe_table

RENDERER = MarkdownIt("commonmark", {"html": False}).enable("table")


@pytest.mark.parametrize(
    "text",
    ["D <wide> & *deep*", "`a` | b", "_first_ and d_noise", "[a](b) ![c](d)", r"C:\x\*", "&lt;"],
)
def test_escaped_text_is_shown_as_it_is(text: str) -> None:
    assert RENDERER.renderInline(escape(text)) == html.escape(text, quote=False)
    shown = RENDERER.render(pipe_table(["Heading"], [[escape(text)]]))
    assert f"<td>{html.escape(text, quote=False)}</td>" in shown


def test_names_stay_readable() -> None:
    assert escape("reports/d_noise (4 cores), 0.5 mm") == "reports/d_noise (4 cores), 0.5 mm"


def test_no_tag_is_left_and_no_line_ends() -> None:
    assert escape("D\n\n<script>alert(1)</script>") == "D &lt;script&gt;alert(1)&lt;/script&gt;"
