"""The docs' commands for trainings and sweeps run, with one job each of one step."""

import re
from collections.abc import Sequence
from pathlib import Path

import pytest
from hydra.core.override_parser.overrides_parser import OverridesParser

from tests.pipeline.conftest import cloned, replace_in, run_here
from tests.pipeline.small_data import write_training_data
from tests.test_documented_commands import FOUND

DETECTOR = ("pipelines/train.py", "variant=detector", "out=models/detector")
ELSEWHERE = re.compile(".* trainer=(ddp|slurm)")  # several devices
# Two processes of a training would leave the tests' process in their group.
ALONE = {
    "trainer.devices=2": "trainer.devices=1",
    "+trainer.strategy=ddp": "+trainer.strategy=auto",
}
# The trainings of each page, in their order: some start from the result of another one.
PAGES: dict[str, list[list[str]]] = {}
for page, words in FOUND:
    if words[:2] == ["python", "pipelines/train.py"] and not ELSEWHERE.match(" ".join(words)):
        PAGES.setdefault(page, []).append(words[1:])


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A clone with data in miniature, and a detector."""
    folder = cloned(tmp_path_factory.mktemp("documented"))
    write_training_data(folder)
    # A process for images, forked from one that holds MLflow's threads, may never end.
    replace_in(folder / "params.yaml", "loader_workers: null", "loader_workers: 0")
    sizes = folder / "conf/profiles.yaml"
    replace_in(sizes, "  steps: 6\n  warmup_steps: 2\n", "  steps: 1\n  warmup_steps: 0\n")
    replace_in(sizes, "  validate_every: 3\n", "  validate_every: 1\n")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        run_here(*DETECTOR)
    return folder


@pytest.mark.parametrize("page", PAGES)
def test_a_pages_trainings_run(page: str, project: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(project)
    for command in PAGES[page]:
        before = results(project)
        run_here(*(word.replace("NAME", "c") for word in shortened(command)))
        written = results(project).items() - before.items()
        assert len(written) == 1, command


def test_trainings_are_found() -> None:
    assert len(PAGES) > 4


def results(project: Path) -> dict[Path, int]:
    """The trained networks outside the scratch folder, and when they were written."""
    found = [path for path in project.rglob("model.ckpt") if "scratch" not in path.parts]
    return {path: path.stat().st_mtime_ns for path in found}


def shortened(command: Sequence[str]) -> list[str]:
    """A command in one process, whose sweep has one job: its first."""
    words = [
        f"{word.partition('=')[0]}={values(word)[0]}" if values(word) else word for word in command
    ]
    return [ALONE.get(word, word.replace("trials=30", "trials=1")) for word in words]


def values(word: str) -> list[str]:
    """The values that an argument gives to the jobs of a sweep; none, if it is no list of them."""
    if not re.match(r"[\w.]+=", word):
        return []
    (override,) = OverridesParser.create().parse_overrides([word])
    return list(override.sweep_string_iterator()) if override.is_discrete_sweep() else []
