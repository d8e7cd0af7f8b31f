"""An unfinished training: where its state is kept, and what it is recognised by."""

import hashlib
import json
import shutil
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.metadata import version
from pathlib import Path
from typing import Any

import yaml
from filelock import AcquireReturnProxy, FileLock, Timeout
from stage import SCRATCH, Config

from shaftpose.errors import InputError
from shaftpose.files import new_file

LAST_CHECKPOINT = "last.ckpt"

# What determines a training, besides code and data: parts of the configuration, less what may
# change in between, and packages. Trainings that are compared must agree in the first ones.
_RECIPE = ("size", "backbone", "loss", "poses", "training")
_OTHER_PARTS = ("seed", "camera", "trainer")
_FREE = {"loader_workers", "checkpoint_minutes", "max_hours"}  # of `training`
_CALLED = {"name", "title"}  # of `variant`
_PACKAGES = ("torch", "lightning", "numpy", "opencv-python-headless")

# The data loaders of a training that was killed hold its lock until they notice, within seconds.
_PATIENCE_S = 30.0


@contextmanager
def kept(folder: Path) -> Iterator[str]:
    """Keep a training in `folder` until it is finished: then the folder is removed.

    Yields the training's id, which stays the same when it is interrupted and goes on. Raises
    InputError if another process has the same training.
    """
    folder.parent.mkdir(parents=True, exist_ok=True)
    with _held(folder.with_suffix(".lock")):
        folder.mkdir(exist_ok=True)
        yield _training_id(folder / "training_id")
        shutil.rmtree(folder)


def _held(path: Path) -> AcquireReturnProxy:
    try:
        return FileLock(path).acquire(timeout=_PATIENCE_S)
    except Timeout as error:
        raise InputError(
            f"{path}: another process trains with these settings; wait for it or stop it"
        ) from error


def _training_id(note: Path) -> str:
    if not note.is_file():
        with new_file(note) as part:
            part.write_text(uuid.uuid4().hex)
    return note.read_text()


def scratch_folder(config: Config, data_facts: dict[str, Any]) -> Path:
    """The folder of the training that the configuration describes, on these data."""
    return SCRATCH / "training" / fingerprint(config, data_facts)


def recipe(config: Config) -> dict[str, Any]:
    """The settings in which trainings that are compared must agree: not variant, nor seed."""
    parts = {part: config[part] for part in _RECIPE}
    parts["training"] = {k: v for k, v in config["training"].items() if k not in _FREE}
    return parts


def settings_of_variant(config: Config) -> dict[str, Any]:
    """The settings in which trainings of one variant must agree: all but what it is called.

    Each may start from a detector of its own seed, as long as all do.
    """
    settings = {key: value for key, value in config["variant"].items() if key not in _CALLED}
    return settings | {"start": settings["start"] is not None}


def settings_of(config: Config) -> dict[str, Any]:
    """All settings that determine a training."""
    named = {"name": config["variant"]["name"], **settings_of_variant(config)}
    return recipe(config) | {"variant": named} | {part: config[part] for part in _OTHER_PARTS}


def fingerprint(config: Config, data_facts: dict[str, Any]) -> str:
    """Hexadecimal digest of all that determines a training: settings, code, packages and data.

    data_facts: what `digests.about_data` says.
    """
    described = [settings_of(config), data_facts]
    digest = hashlib.sha256(json.dumps(described, sort_keys=True).encode())
    for package in _PACKAGES:
        digest.update(f"{package} {version(package)}".encode())
    for path in code_files():
        digest.update(path.name.encode() + path.read_bytes())
    return digest.hexdigest()[:16]


def code_files() -> list[Path]:
    """The code that determines a training: what dvc.yaml lists for its stage."""
    root = Path(__file__).parents[1]
    stages = yaml.safe_load((root / "dvc.yaml").read_text())["stages"]
    deps: list[str] = stages["train"]["deps"]
    listed = [root / name for name in deps if not name.startswith(("data/", "models/"))]
    found = [sorted(path.rglob("*.py")) if path.is_dir() else [path] for path in listed]
    return [path for paths in found for path in paths]
