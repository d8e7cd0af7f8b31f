"""The model bundled with the package."""

import hashlib
from importlib.resources import files
from pathlib import Path

from shaftpose.errors import InputError

FOLDER = Path(str(files("shaftpose"))) / "models"
MODEL, CHECKSUM = "shaftpose.onnx", "shaftpose.onnx.sha256"

_REMEDY = "reinstall the package, or name another model"


def bundled_model() -> Path:
    """The file of the bundled model, after a check of its SHA-256.

    Raises InputError naming the file if it is missing or damaged.
    """
    model, recorded = FOLDER / MODEL, FOLDER / CHECKSUM
    for path in (model, recorded):
        if not path.is_file():
            raise InputError(f"{path}: missing; {_REMEDY}")
    if recorded.read_bytes() != checksum(model):
        raise InputError(f"{model}: damaged, its SHA-256 differs from {CHECKSUM}; {_REMEDY}")
    return model


def checksum(model: Path) -> bytes:
    """The line that `sha256sum` prints about a file in its folder."""
    return f"{hashlib.sha256(model.read_bytes()).hexdigest()}  {model.name}\n".encode()
