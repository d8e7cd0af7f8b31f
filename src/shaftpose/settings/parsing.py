"""Conversion of composed values to the dataclasses of `parts`, and of these to JSON."""

from collections.abc import Mapping
from typing import Any, TypeVar

from pydantic import TypeAdapter, ValidationError

from shaftpose.core.errors import InputError

T = TypeVar("T")

# Keys that files of older versions lack, with the values that preserve their meaning.
_NEW_KEYS = {
    "depth": "depth: 1.0",
    "detector_steps": "detector_steps: 1000",  # used only where a variant starts from the detector
    "optimizer": "optimizer: adam",
    "start": "start: null",
    "pose_loss": "pose_loss: true",
    "symmetries": "symmetries: false",
}


def parse(kind: type[T], values: Mapping[str, Any], where: str) -> T:
    """Parse `values` as a `kind`.

    where: the location of the values, e.g. "params.yaml: loss"; error messages start with it.
    Raises InputError naming the first wrong key, its value and the allowed ones.
    """
    try:
        return TypeAdapter(kind).validate_python(dict(as_mapping(values, where)))
    except ValidationError as error:
        raise InputError(_first_complaint(error, where)) from error


def as_mapping(values: object, where: str) -> Mapping[str, Any]:
    """The values. Raises InputError naming their location if they are not keys and values."""
    if not isinstance(values, Mapping):
        raise InputError(f"{where} = {values!r}: must hold keys and values")
    return values


def _first_complaint(error: ValidationError, where: str) -> str:
    first = error.errors()[0]
    key = ".".join(str(part) for part in first["loc"])
    if first["type"] == "missing":
        return f"{where}.{key} is missing; add {_NEW_KEYS.get(key, 'it')}"
    message = first["msg"].removeprefix("Value error, ")
    if not key:  # concerns several keys
        return f"{where}: {message}"
    return f"{where}.{key} = {first['input']!r}: {message}"


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
