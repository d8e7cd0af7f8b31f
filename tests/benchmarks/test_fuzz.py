"""Damaged and odd inputs: a few cases, and what counts as a failure."""

from pathlib import Path

import pytest
from numpy.random import Generator

from benchmarks import fuzz
from benchmarks.fuzz_cases import KINDS
from shaftpose.core.errors import InputError


def test_each_kind_is_read_or_refused_in_words() -> None:
    found = fuzz.run(seed=3, first=0, end=len(KINDS))
    assert {kind for kind, _ in found} == {kind.__name__ for kind in KINDS}
    assert {outcome for _, outcome in found} <= set(fuzz.GOOD)


def raises(error: Exception) -> object:
    def kind(_folder: Path, _rng: Generator) -> None:
        raise error

    return kind


@pytest.mark.parametrize(
    ("error", "outcome"),
    [
        (InputError("a.yaml: no camera"), "refused"),
        (InputError("two\nlines"), "mute"),
        (AssertionError(), "lost"),
        (ZeroDivisionError(), "traceback"),
    ],
)
def test_outcomes(error: Exception, outcome: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fuzz, "KINDS", (raises(error),))
    assert fuzz.outcome_of(0, 0).split()[0] == outcome


def test_a_process_that_dies_is_counted_and_the_rest_goes_on(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A worker reads case 0, dies at case 1, and the next one reads case 2."""
    code = "import os; print('case read', flush=True); {first} or os.kill(os.getpid(), 11)"
    real = fuzz.subprocess.Popen

    def popen(command: list[str], **options: object) -> object:
        first = command[-2].removeprefix("--first=")
        return real([command[0], "-c", code.format(first=first)], **options)

    monkeypatch.setattr(fuzz.subprocess, "Popen", popen)
    found = fuzz.run(seed=0, first=0, end=3)
    assert sorted(outcome for _, outcome in found.elements()) == ["crash", "read", "read"]
