"""Rendering of the Markdown templates in this folder."""

from pathlib import Path
from typing import Any

from jinja2 import Environment, StrictUndefined


def rendered(template: str, **values: Any) -> str:
    """The text of a template; a value that it needs and lacks is an error."""
    environment = Environment(
        undefined=StrictUndefined, trim_blocks=True, keep_trailing_newline=True
    )
    return environment.from_string(Path(__file__).with_name(template).read_text()).render(**values)
