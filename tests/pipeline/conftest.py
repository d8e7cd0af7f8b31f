"""A clone of the project at the `smoke` profile, in which the real pipeline runs."""

import logging
import os
import re
import runpy
import shutil
import subprocess
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path

import mlflow
import pytest

from shaftpose.settings.compose import composed_settings
from shaftpose.settings.tree import Settings
from shaftpose.training.recipe import Recipe, training_recipe
from tests.pipeline.small_data import write_training_data

ROOT = Path(__file__).parents[2]


def settings_with(*overrides: str) -> Settings:
    """The project's settings with overrides as on a stage's command line."""
    return composed_settings(ROOT, *overrides)


def recipe_with(*overrides: str) -> Recipe:
    """The recipe of the training with these settings."""
    return training_recipe(settings_with(*overrides)).resolved()


Run = Callable[..., subprocess.CompletedProcess[str]]


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder in which the stage `train` runs."""
    folder = tmp_path_factory.mktemp("project")
    write_training_data(folder)
    return folder


@pytest.fixture
def inside(project: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The same folder, as the working directory."""
    monkeypatch.chdir(project)
    return project


# Settings that users change in params.yaml -> values for the tests. Trailing comments are dropped.
SETTINGS = {
    "profile": "smoke",
    "variants": "[d_noise_real]",
    "  source": "null",  # of backgrounds and of real images
}


@pytest.fixture(scope="session")
def clone(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A Git repository of the tracked files as they are now, changed by `SETTINGS`."""
    return cloned(tmp_path_factory.mktemp("clone"))


def cloned(folder: Path) -> Path:
    """Make an empty folder such a repository; return it."""
    copy_tracked(ROOT, folder)
    (folder / "dvc.lock").unlink(missing_ok=True)
    text = (folder / "params.yaml").read_text()
    for key, value in SETTINGS.items():
        text = re.sub(f"^{key}:.*", f"{key}: {value}", text, flags=re.MULTILINE)
    (folder / "params.yaml").write_text(text)
    commit(folder)
    return folder


def copy_tracked(source: Path, target: Path) -> None:
    """Copy the files of a working tree that Git tracks or would track, as they are now."""
    listed = subprocess.run(
        ["git", "ls-files", "--cached", "--others", "--exclude-standard"],
        cwd=source, capture_output=True, text=True, check=True,
    )  # fmt: skip
    for name in listed.stdout.splitlines():
        if (source / name).is_file():
            (target / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(source / name, target / name, follow_symlinks=False)


def commit(folder: Path) -> None:
    """Make a folder a Git repository with one commit."""
    identity = ["-c", "user.name=test", "-c", "user.email=test@example.org"]
    for command in (["init", "-q"], ["add", "-A"], ["commit", "-qm", "Clone"]):
        subprocess.run(["git", *identity, *command], cwd=folder, check=True)


@pytest.fixture(scope="session")
def run(clone: Path) -> Run:
    """Runs a command in the clone."""
    return partial(run_in, clone)


def run_in(clone: Path, *command: str) -> subprocess.CompletedProcess[str]:
    """Run a command in a clone with this Python's programs and the clone's package."""
    environment = os.environ | {
        "PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}",
        "PYTHONPATH": str(clone / "src"),
    }
    environment.pop("MLFLOW_TRACKING_URI", None)
    # Trainings of seconds would end before MLflow's first sample, after 10 s.
    environment["MLFLOW_SYSTEM_METRICS_SAMPLING_INTERVAL"] = "1"
    return subprocess.run(
        command, cwd=clone, env=environment, capture_output=True, text=True, timeout=900
    )


def run_here(script: str | Path, *arguments: str) -> None:
    """Run a script in this process and its working directory: a new one imports torch again.

    Leaves logging and MLflow as they were.
    """
    database, log = mlflow.get_tracking_uri(), logging.root
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", [str(script), *arguments])
        patch.setenv("MLFLOW_TRACKING_URI", "")  # so that what the script sets is undone
        patch.delenv("MLFLOW_TRACKING_URI")
        patch.setattr(log, "handlers", log.handlers.copy())
        patch.setattr(log, "level", log.level)
        try:
            runpy.run_path(str(script), run_name="__main__")
        finally:
            mlflow.set_tracking_uri(database)


def replace_in(path: Path, old: str, new: str) -> None:
    """Replace text that must exist."""
    text = path.read_text()
    assert old in text, f"{path} lacks {old!r}"
    path.write_text(text.replace(old, new))
