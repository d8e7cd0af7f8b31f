"""The docs' commands for trainings and sweeps run as they are written, at a small size."""

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
# Each command once, in the order of the docs: some start from another one's result.
COMMANDS = [
    tuple(words[1:])
    for words in dict.fromkeys(tuple(words) for _, words in FOUND)
    if words[:2] == ("python", "pipelines/train.py") and not ELSEWHERE.match(" ".join(words))
]


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


@pytest.mark.parametrize("command", COMMANDS, ids=" ".join)
def test_the_training_runs(
    command: tuple[str, ...], project: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(project)
    before = set(project.rglob("model.ckpt"))
    run_here(*(word.replace("NAME", "c") for word in shortened(command)))
    new = set(project.rglob("model.ckpt")) - before
    trained = {path for path in new if "scratch" not in path.parts}
    assert len(trained) == (2 if "-m" in command else 1)


def shortened(command: Sequence[str]) -> list[str]:
    """A command whose sweep has two jobs."""
    lists = {word: values(word) for word in command if values(word)}
    kept = {word: found[: 1 if n else 2] for n, (word, found) in enumerate(lists.items())}
    words = [
        f"{word.partition('=')[0]}={','.join(kept[word])}" if word in kept else word
        for word in command
    ]
    return [word.replace("trials=30", "trials=2") for word in words]


def values(word: str) -> list[str]:
    """The values that an argument gives to the jobs of a sweep; none, if it is no list of them."""
    if not re.match(r"[\w.]+=", word):
        return []
    (override,) = OverridesParser.create().parse_overrides([word])
    return list(override.sweep_string_iterator()) if override.is_discrete_sweep() else []
