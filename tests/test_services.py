"""The servers of a team: MLflow's model server, its database in PostgreSQL, DVC's remote by SSH."""

import json
import os
import shutil
import subprocess
import sys
import urllib.request
from pathlib import Path

import numpy as np
import pytest

from shaftpose.core.images import centre_square
from shaftpose.image_files.reading import read_rgb
from shaftpose.inference.model_files import DEFAULT, bundled_model
from shaftpose.inference.predictor import Predictor
from shaftpose.tracking.models import log_model
from tests.servers import BIN, free_port, server
from tests.tracking.registering import register

ROOT = Path(__file__).parents[1]
FRAME = ROOT / "src/shaftpose/inference/demo_frame.jpg"


def test_mlflows_server_answers_as_the_model_does(
    store: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    image = centre_square(read_rgb(FRAME), 299)[None]
    log_model("id-1", "e", bundled_model(DEFAULT), image)
    register("id-1")
    monkeypatch.setenv("MLFLOW_TRACKING_URI", f"sqlite:///{store / 'mlflow.db'}")
    # The server starts a second process by the name `python`.
    monkeypatch.setenv("PATH", f"{BIN}{os.pathsep}{os.environ['PATH']}")
    port = free_port()
    command = [
        str(BIN / "mlflow"), "models", "serve", "-m", "models:/shaftpose@champion",
        "--env-manager", "local", "-h", "127.0.0.1", "-p", str(port),
    ]  # fmt: skip
    with server(command, port, store / "server.log"):
        request = urllib.request.Request(
            f"http://127.0.0.1:{port}/invocations",
            json.dumps({"inputs": {"image": image.tolist()}}).encode(),
            {"Content-Type": "application/json"},
        )
        with urllib.request.urlopen(request, timeout=60) as reply:
            answer = json.load(reply)["predictions"]
    (found,) = Predictor(bundled_model(DEFAULT), refine="none")(image)
    assert len(found.scores) > 0
    for name in ("boxes", "scores", "poses"):
        expected = getattr(found, name)
        np.testing.assert_allclose(np.array(answer[name])[0, : len(expected)], expected, atol=1e-4)


def test_a_team_tracks_in_postgresql(tmp_path: Path, constant_model: Path) -> None:
    if shutil.which("pg_virtualenv") is None:
        pytest.skip("needs PostgreSQL: sudo apt-get install -y postgresql")
    command = [sys.executable, "-m", "tests.team", str(constant_model), str(tmp_path)]
    run(ROOT, "pg_virtualenv", "-t", *command)


def test_renders_and_models_are_shared_by_ssh(tmp_path: Path) -> None:
    sshd = shutil.which("sshd") or shutil.which("/usr/sbin/sshd")
    if sshd is None:
        pytest.skip("needs an SSH server: sudo apt-get install -y openssh-server")
    keys, port = tmp_path / "keys", free_port()
    keys.mkdir()
    for name in ("host", "user"):
        run(tmp_path, "ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-f", str(keys / name))
    (keys / "config").write_text(
        f"Port {port}\nListenAddress 127.0.0.1\nHostKey {keys}/host\n"
        f"AuthorizedKeysFile {keys}/user.pub\nStrictModes no\nPermitRootLogin yes\n"
        "Subsystem sftp internal-sftp\nPidFile none\n"
    )
    if os.geteuid() == 0:
        Path("/run/sshd").mkdir(exist_ok=True)  # which sshd demands of root
    shared, command = tmp_path / "shared", [sshd, "-D", "-e", "-f", str(keys / "config")]
    with server(command, port, tmp_path / "sshd.log"):
        first = tmp_path / "first"
        first.mkdir()
        run(first, "git", "init", "-q")
        dvc(first, "init", "-q")
        dvc(first, "remote", "add", "-d", "team", f"ssh://127.0.0.1:{port}{shared}")
        dvc(first, "remote", "modify", "team", "keyfile", str(keys / "user"))
        (first / "renders").mkdir()
        (first / "renders" / "shard-000000.tar").write_bytes(bytes(range(256)) * 100)
        dvc(first, "add", "-q", "renders")
        dvc(first, "push", "-q")
        second = tmp_path / "second"
        shutil.copytree(first, second, ignore=shutil.ignore_patterns("cache", "renders", "tmp"))
        dvc(second, "pull", "-q")
    copy = second / "renders" / "shard-000000.tar"
    assert copy.read_bytes() == bytes(range(256)) * 100
    assert any(shared.rglob("*"))


def dvc(folder: Path, *arguments: str) -> None:
    run(folder, sys.executable, "-m", "dvc", *arguments)


def run(folder: Path, *command: str) -> None:
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True)
    assert done.returncode == 0, f"{command}: {done.stdout}{done.stderr}"
