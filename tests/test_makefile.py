"""`make help` lists every target."""

import re
import shutil
import subprocess
import sys
from functools import partial
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).parents[1]
TEXT = (ROOT / "Makefile").read_text()
# Target -> rest of its line, without `.PHONY` and files such as `$(READY)`.
RULES = dict(re.findall(r"^([a-z][a-z%-]*):(?!=)(.*)$", TEXT, re.MULTILINE))


def test_every_target_has_a_line_of_help() -> None:
    assert {"help", "repro", "test", "variant-%"} <= RULES.keys()
    assert [name for name, rest in RULES.items() if not re.search(r"  ## \w", rest)] == []


def test_every_target_that_is_no_file_is_declared_so() -> None:
    (declared,) = re.findall(r"^\.PHONY: (.*)$", TEXT, re.MULTILINE)
    assert declared.split() == [name for name in RULES if "%" not in name]


@pytest.mark.skipif(shutil.which("make") is None, reason="make is not installed")
def test_help_lists_every_target() -> None:
    command = ["make", "--no-print-directory", "help"]
    result = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    assert [line.split()[0] for line in result.stdout.splitlines()] == list(RULES)


@pytest.mark.skipif(shutil.which("make") is None, reason="make is not installed")
def test_variants_are_read_in_the_style_in_which_dvc_writes_them(tmp_path: Path) -> None:
    (tmp_path / "Makefile").write_text(TEXT)
    (tmp_path / "params.yaml").write_text("variants:\n- c\n- d_noise\n- e\n")
    command = ["make", "--dry-run", f"VENV={sys.prefix}", "READY=", "JOBS=1", "repro"]
    result = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True)
    assert re.findall(r" train@(\w+)", result.stdout) == ["e", "d_noise", "c"]


@pytest.mark.skipif(shutil.which("make") is None, reason="make is not installed")
def test_only_targets_that_train_need_a_list_of_variants(tmp_path: Path) -> None:
    (tmp_path / "Makefile").write_text(TEXT)
    (tmp_path / "params.yaml").write_text("variants: []\n")
    command = ["make", "--dry-run", f"VENV={sys.prefix}", "READY="]
    run = partial(subprocess.run, cwd=tmp_path, capture_output=True, text=True)
    assert run([*command, "ui"]).returncode == 0
    refused = run([*command, "repro"])
    assert "params.yaml: `variants` must be a list of names" in refused.stderr
    assert refused.returncode != 0


def test_commits_are_checked_by_the_same_linters() -> None:
    lint = re.search(r"^lint:.*\n((?:\t.*\n)+)", TEXT, re.MULTILINE)
    assert lint is not None
    commands = [line.removesuffix(" .") for line in lint[1].split("\n\t")]
    (repository,) = yaml.safe_load((ROOT / ".pre-commit-config.yaml").read_text())["repos"]
    entries = [hook["entry"].removeprefix(".venv/bin/") for hook in repository["hooks"]]
    assert entries == [command.strip().removesuffix(" .") for command in commands]
