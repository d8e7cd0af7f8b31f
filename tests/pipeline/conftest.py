"""A clone of the project at the `smoke` profile, in which the real pipeline runs."""

import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]

Run = Callable[..., subprocess.CompletedProcess[str]]


@pytest.fixture(scope="session")
def clone(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The tracked files as they are now, a Git repository of their own, profile `smoke`."""
    folder = tmp_path_factory.mktemp("clone")
    listed = subprocess.run(
        ["git", "ls-files", "--cached", "--others", "--exclude-standard"],
        cwd=ROOT, capture_output=True, text=True, check=True,
    )  # fmt: skip
    for name in listed.stdout.splitlines():
        if (ROOT / name).is_file() and name != "dvc.lock":
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, folder / name)
    replace_in(folder / "params.yaml", "profile: demo", "profile: smoke")
    for command in (["init", "-q"], ["add", "-A"], ["commit", "-qm", "Clone"]):
        subprocess.run(["git", *IDENTITY, *command], cwd=folder, check=True)
    return folder


IDENTITY = ["-c", "user.name=test", "-c", "user.email=test@example.org"]


@pytest.fixture(scope="session")
def run(clone: Path) -> Run:
    """Runs a command in the clone with this Python's programs and the clone's package."""

    def run_in_clone(*command: str) -> subprocess.CompletedProcess[str]:
        environment = os.environ | {
            "PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}",
            "PYTHONPATH": str(clone / "src"),
        }
        environment.pop("MLFLOW_TRACKING_URI", None)
        # Trainings of seconds would be over before the first of MLflow's samples, 10 s apart.
        environment["MLFLOW_SYSTEM_METRICS_SAMPLING_INTERVAL"] = "1"
        return subprocess.run(
            command, cwd=clone, env=environment, capture_output=True, text=True, timeout=900
        )

    return run_in_clone


def replace_in(path: Path, old: str, new: str) -> None:
    """Replace text that must be there."""
    text = path.read_text()
    assert old in text, f"{path} lacks {old!r}"
    path.write_text(text.replace(old, new))
