"""Pages of the documentation: tables between markers, and templates of this folder."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from jinja2 import Environment, StrictUndefined

from shaftpose.core.errors import InputError


def rewrite(path: Path, change: Callable[[str], str]) -> None:
    """Apply `change` to a page."""
    path.write_text(change(path.read_text()))


def with_tables(page: str, tables: Mapping[str, str], command: str, name: str) -> str:
    """The page with each table between the markers of its name.

    command: writes the tables, as stated in the markers; name: the page's, for messages. Raises
    InputError if the page lacks a marker.
    """
    for table, text in tables.items():
        start, end = f"<!-- {table}: {command} -->\n", f"<!-- end of {table} -->"
        if not 0 <= page.find(start) < page.find(end):
            raise InputError(f"{name}: lacks the markers {start.strip()!r} and {end!r}; add them")
        before, _, rest = page.partition(start)
        page = f"{before}{start}\n{text}\n\n{end}{rest.partition(end)[2]}"
    return page


def rendered(template: str, **values: Any) -> str:
    """The text of a template; a value that it needs and lacks is an error."""
    environment = Environment(
        undefined=StrictUndefined, trim_blocks=True, keep_trailing_newline=True
    )
    return environment.from_string(Path(__file__).with_name(template).read_text()).render(**values)
