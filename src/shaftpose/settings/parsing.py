"""Conversion of composed values to the dataclasses of `schema`, and of these to JSON."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any, TypeVar

from pydantic import TypeAdapter, ValidationError

from shaftpose.core.errors import InputError

T = TypeVar("T")


def parse(kind: type[T], values: object, where: str) -> T:
    """Parse `values` as a `kind`.

    where: prefix of the keys' names in messages, e.g. "params.yaml: ".
    Raises InputError naming the first wrong key, its value and the allowed ones.
    """
    with first_complaint(where):
        return TypeAdapter(kind).validate_python(values)


@contextmanager
def first_complaint(where: str) -> Iterator[None]:
    """Turn pydantic's error into an InputError that names the first wrong key; see `parse`."""
    try:
        yield
    except ValidationError as error:
        raise InputError(_described(error, where)) from error


def _described(error: ValidationError, where: str) -> str:
    first = error.errors()[0]
    key = where + ".".join(str(part) for part in first["loc"])
    message = first["msg"].removeprefix("Value error, ")
    if first["type"] == "missing":
        return f"{key} is missing; add it"
    if first["type"] == "unexpected_keyword_argument":
        message = "unknown; remove it, or move it into its section"
    if first["type"] == "value_error" and not isinstance(first["input"], int | float | str | list):
        return f"{key.rstrip('. :')}: {message}"  # concerns several keys
    return f"{key.rstrip('. :')} = {first['input']!r}: {message}"


def to_json(settings: object) -> str:
    """A settings object as JSON; `stage_files.read_stage_file` reads it back."""
    return TypeAdapter(type(settings)).dump_json(settings, indent=1).decode()


def flatten(values: Mapping[str, Any], separator: str = ".") -> dict[str, Any]:
    """{"loss": {"alpha": 1}} -> {"loss.alpha": 1}; sequences stay whole."""
    flat: dict[str, Any] = {}
    for key, value in values.items():
        if isinstance(value, Mapping):
            inner = flatten(value, separator)
            flat |= {f"{key}{separator}{name}": one for name, one in inner.items()}
        else:
            flat[key] = value
    return flat


def as_plain(settings: object) -> dict[str, Any]:
    """A settings object as numbers, strings, lists and dictionaries."""
    plain: dict[str, Any] = TypeAdapter(type(settings)).dump_python(settings, mode="json")
    return plain
