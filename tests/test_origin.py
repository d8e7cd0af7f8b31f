"""Where results come from."""

import subprocess
import sys
from pathlib import Path

import pytest

from shaftpose.origin import origin


def git(*arguments: str) -> str:
    user = ["-c", "user.name=a", "-c", "user.email=a@example.org"]
    done = subprocess.run(["git", *user, *arguments], check=True, capture_output=True, text=True)
    return done.stdout.strip()


def test_an_origin_states_command_code_and_machine(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["pipelines/evaluate.py", "variant=d", "out=my reports"])
    monkeypatch.setenv("GIT_CEILING_DIRECTORIES", str(tmp_path.parent))
    found = origin()
    assert found.command == "python pipelines/evaluate.py variant=d 'out=my reports'"
    assert found.commit == ""
    assert found.machine.endswith(" cores")
    git("init", "-q")
    for name in ("stage.py", "report.json"):
        Path(name).write_text("1\n")
    git("add", ".")
    git("commit", "-q", "-m", "Start")
    head = git("rev-parse", "HEAD")[:12]
    assert origin().commit == head
    Path("report.json").write_text("2\n")  # a stage's output
    assert origin().commit == head
    Path("stage.py").write_text("2\n")
    assert origin().commit == f"{head}+"
    git("checkout", "-q", "stage.py")
    Path("notes.txt").touch()
    assert origin().commit == head
    new = Path("conf/variant/new.yaml")
    new.parent.mkdir(parents=True)
    new.touch()
    assert origin().commit == f"{head}+"
    git("config", "status.showUntrackedFiles", "no")
    assert origin().commit == f"{head}+"
    new.unlink()
    assert origin().commit == head
    Path(".git/index").write_text("damaged")  # git status fails
    assert origin().commit == f"{head}+"
