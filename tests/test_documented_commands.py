"""The commands of README and docs are ones that this version takes."""

import io
import re
import runpy
import shlex
import sys
from collections.abc import Iterable, Iterator
from itertools import groupby, pairwise
from pathlib import Path

import cv2
import numpy as np
import pytest
from dvc.cli import parse_args
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import Override

from shaftpose.cli.main import main
from shaftpose.cli.options import parser
from shaftpose.settings.compose import composed_settings
from tests.frame_sources.videos import write_video
from tests.inference.test_calibration_files import PINHOLE

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
TARGETS = set(re.findall(r"^([a-z-]+):.*##", (ROOT / "Makefile").read_text(), re.MULTILINE))
BLOCK = re.compile(r"^```(\w*)\n(.*?)^```", re.DOTALL | re.MULTILINE)
VARIABLE = re.compile(r"[A-Z_]+=\S*")


def commands(page: Path) -> Iterator[list[str]]:
    """The words of each command in a page's blocks of code."""
    for language, block in BLOCK.findall(page.read_text()):
        if language not in ("", "bash"):
            continue
        for line in block.replace("\\\n", " ").splitlines():
            for words in split_at_operators(line):
                while words and VARIABLE.fullmatch(words[0]):
                    words = words[1:]
                if words:
                    yield words


def split_at_operators(line: str) -> Iterator[list[str]]:
    """The commands of a line that the shell joins by `&&`, `|` or `>`."""
    words = shlex.shlex(line, posix=True, punctuation_chars="&|>")
    words.whitespace_split = True
    for operator, group in groupby(words, key=lambda word: set(word) <= set("&|>")):
        if not operator:
            yield list(group)


def in_prose(page: Path) -> Iterator[list[str]]:
    """The words of each command of make, dvc and `python -m` in a page's sentences, which mention
    modules without arguments, too."""
    sentences = BLOCK.sub("", page.read_text())
    for command in re.findall(r"`((?:make|dvc|python\s+-m)\s[^`]+)`", sentences):
        words = shlex.split(command)
        if words[0] != "python" or len(words) > 3:
            yield words


FOUND = [(page.name, words) for page in PAGES for words in commands(page)]
IN_PROSE = [(page.name, words) for page in PAGES for words in in_prose(page)]


def of(*names: str, but: Iterable[str] = ()) -> list[object]:
    """The commands that begin so and lack the words `but`, as parameters of a test."""
    return [
        pytest.param(words, id=f"{page}: {shlex.join(words)}")
        for page, words in FOUND + IN_PROSE
        if tuple(words[: len(names)]) == names and not {*but} & {*words}
    ]


@pytest.mark.parametrize("words", of("make"))
def test_make_has_the_target(words: list[str]) -> None:
    named = [word for word in words[1:] if "=" not in word]
    assert {re.sub("^variant-.*", "variant-", name) for name in named} <= TARGETS | {"variant-"}


@pytest.mark.parametrize("words", of("shaftpose"))
def test_the_command_line_takes_the_options(words: list[str]) -> None:
    parser().parse_args(words[1:])


def of_users_files() -> list[object]:
    """The commands for a user's own files, each once; not those for a camera, for trained models,
    and of the tutorial, which the test of the whole pipeline runs."""
    elsewhere = re.compile("0|models/.*|mine/.*")
    found = {
        tuple(words) for _, words in FOUND
        if words[:2] in (["shaftpose", "predict"], ["shaftpose", "check"], ["shaftpose", "models"])
        and not any(map(elsewhere.fullmatch, words))
    }  # fmt: skip
    return [pytest.param(words, id=shlex.join(words)) for words in sorted(found)]


@pytest.fixture
def _users_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A folder with the files that the commands name, as the working directory."""
    monkeypatch.chdir(tmp_path)
    frame = np.full((480, 640, 3), 90, np.uint8)
    write_video(tmp_path / "operation.mp4", [90, 90], 640, 480)
    (tmp_path / "frames").mkdir()
    for name in ("frame.png", "frames/frame.png"):
        cv2.imwrite(name, frame)
    (tmp_path / "cam.yaml").write_text(PINHOLE)
    monkeypatch.setattr("sys.stdin", io.StringIO("frame.png\n"))


@pytest.mark.usefixtures("_users_files")
@pytest.mark.parametrize("words", of_users_files())
def test_the_command_runs_on_a_users_files(
    words: tuple[str, ...], capsys: pytest.CaptureFixture[str]
) -> None:
    few = ["2" if before == "--workers" else word for before, word in pairwise(words)]
    main(few)
    assert capsys.readouterr().out or Path("found").is_dir() or Path("many").is_dir()


@pytest.mark.parametrize("words", of("dvc"))
def test_dvc_takes_the_options(words: list[str]) -> None:
    parse_args(words[1:])


# They need no files, and take minutes: tests/studies runs parts of them.
LONG = {"studies.write_results_page", "studies.whole_frames"}


@pytest.mark.parametrize("words", of("python", "-m", but=LONG))
def test_the_module_takes_the_options(
    words: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In a folder without results, it says what is missing."""
    for name in ("conf", "params.yaml"):
        (tmp_path / name).symlink_to(ROOT / name)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", words[2:])
    with pytest.raises(SystemExit) as ended:
        runpy.run_module(words[2], run_name="__main__")
    assert str(ended.value).startswith("error: ")


SCRIPTS = [one for name in sorted((ROOT / "pipelines").glob("*.py"))
           for one in of("python", f"pipelines/{name.name}")]  # fmt: skip


@pytest.mark.parametrize("words", SCRIPTS)
def test_the_settings_exist(words: list[str]) -> None:
    given = [word.replace("NAME", "d") for word in words[2:] if "=" in word]
    parsed = OverridesParser.create().parse_overrides(given)
    composed_settings(ROOT, *(first(o) for o in parsed if not o.key_or_group.startswith("hydra")))


def first(override: Override) -> str:
    """An override, and of one with several values the first one."""
    if not override.is_sweep_override():
        return override.input_line
    interval = override.is_interval_sweep()
    value = override.value().start if interval else next(override.sweep_string_iterator())
    return f"{override.get_key_element()}={value}"


def test_commands_are_found() -> None:
    programs = {words[0] for _, words in FOUND}
    assert {"make", "shaftpose", "dvc", "python"} <= programs
    assert len(FOUND) > 80
    assert len(IN_PROSE) > 30
