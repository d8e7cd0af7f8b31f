"""`make help` lists every target."""

import re
import shutil
import subprocess
from pathlib import Path

import pytest

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
