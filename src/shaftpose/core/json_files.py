"""Small JSON files."""

import json
from pathlib import Path
from typing import Any

from shaftpose.core.errors import InputError
from shaftpose.core.files import new_file


def write_json(path: Path, content: Any) -> None:
    """Write `content` atomically; create the folder if needed."""
    with new_file(path) as part:
        part.write_text(json.dumps(content, indent=1) + "\n")


def read_json(path: Path, remedy: str) -> Any:
    """Read a JSON file. Raises InputError naming it and the remedy if it is missing or damaged."""
    try:
        return json.loads(path.read_text())
    except FileNotFoundError as error:
        raise InputError(f"{path}: missing; {remedy}") from error
    except ValueError as error:
        raise InputError(f"{path}: cannot be read as JSON ({error}); {remedy}") from error
