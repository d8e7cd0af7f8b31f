"""The models bundled with the package, each with its checksum and its card."""

import hashlib
from importlib.resources import files
from pathlib import Path

from shaftpose.core.errors import InputError

FOLDER = Path(str(files("shaftpose"))) / "models"
DEFAULT = "shaftpose"  # the name of the model that is used if none is named
CHECKSUM_SUFFIX, CARD_SUFFIX = ".onnx.sha256", ".md"

_REMEDY = "reinstall the package, or name another model"


def bundled_names() -> list[str]:
    """The names of the bundled models, the default one first."""
    names = {path.stem for path in FOLDER.glob("*.onnx")} - {DEFAULT}
    return [DEFAULT, *sorted(names)]


def bundled_model(name: str = DEFAULT) -> Path:
    """The file of a bundled model, after a check of its SHA-256.

    Raises InputError naming the file if it is missing or damaged.
    """
    model, recorded = FOLDER / f"{name}.onnx", FOLDER / f"{name}{CHECKSUM_SUFFIX}"
    for path in (model, recorded):
        if not path.is_file():
            raise InputError(f"{path}: missing; {_REMEDY}")
    if recorded.read_bytes() != checksum(model):
        raise InputError(f"{model}: damaged, its SHA-256 differs from {recorded.name}; {_REMEDY}")
    return model


def checksum(model: Path) -> bytes:
    """The line that `sha256sum` prints about a file in its folder."""
    return f"{hashlib.sha256(model.read_bytes()).hexdigest()}  {model.name}\n".encode()
