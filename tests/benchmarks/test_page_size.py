"""`make bench-pages` compares processes with and without huge pages."""

import os
from pathlib import Path

import pytest

from benchmarks import page_size
from tests.pipeline.small_data import write_training_data


def test_the_gain_is_the_median_of_pairs(monkeypatch: pytest.MonkeyPatch) -> None:
    speeds = {"": iter([10.0, 20, 5]), "glibc.malloc.hugetlb=1": iter([15.0, 24, 12])}
    monkeypatch.setattr(page_size, "PROCESSES", 3)
    monkeypatch.setattr(page_size, "speed", lambda what, tunables: next(speeds[tunables]))
    assert page_size.row("training") == {
        "what": "training", "usual_images_per_s": 10, "huge_pages_images_per_s": 15, "gain": 1.5,
    }  # fmt: skip


def test_a_process_has_its_tunables(monkeypatch: pytest.MonkeyPatch) -> None:
    def run(command: list[str], env: dict[str, str], **_: object) -> object:
        assert (command[-2:], env["GLIBC_TUNABLES"]) == (["--time", "prediction"], "a=1")
        assert env["PATH"] == os.environ["PATH"]
        return type("Done", (), {"stdout": "a progress bar\n2.5\n"})

    monkeypatch.setattr(page_size.subprocess, "run", run)
    assert page_size.speed("prediction", "a=1") == 2.5


def test_trainings_and_predictions_are_timed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_training_data(tmp_path)
    monkeypatch.chdir(tmp_path)
    assert 0 < page_size.training("smoke", steps=2) < 1000
    assert 0 < page_size.prediction(1) < 1000
