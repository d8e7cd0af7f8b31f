"""Small JSON files that stages hand on."""

import json
from pathlib import Path
from typing import Any

from shaftpose.errors import InputError


def write_json(path: Path, content: Any) -> None:
    """Write `content`, making the folder if needed; a file that is there is whole."""
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_suffix(".part")
    part.write_text(json.dumps(content, indent=1) + "\n")
    part.replace(path)


def read_json(path: Path, stage: str) -> Any:
    """Read a file that `stage` writes. Raises InputError naming both if it is missing."""
    if not path.is_file():
        raise InputError(f"{path}: missing; run `dvc repro {stage}`")
    return json.loads(path.read_text())


def read_training(model_folder: Path) -> dict[str, Any]:
    """What the train stage notes about a training beside its checkpoint."""
    training: dict[str, Any] = read_json(model_folder / "training.json", "train")
    return training


def read_domain() -> str:
    """What the images of the real domain are: "real", or "stand-in"."""
    return str(read_json(Path("data/real/about.json"), "real_images")["domain"])
