"""Hashes of the data, read from a file that DVC may be writing."""

from pathlib import Path

import pytest

from shaftpose.tracking import dvc_lock
from shaftpose.tracking.dvc_lock import locked_hashes


def test_the_datasets_hashes_come_from_the_lock_file(tmp_path: Path) -> None:
    lock = tmp_path / "dvc.lock"
    assert locked_hashes(lock, Path("data")) == {}
    lock.write_text(
        "stages:\n"
        "  render:\n    outs:\n    - {path: data/render, md5: aa.dir}\n"
        "  train@c:\n    outs:\n    - {path: models/c/model.ckpt, md5: bb}\n"
        "  report:\n    outs:\n    - {path: reports/ablation.html, md5: cc}\n"
    )
    assert locked_hashes(lock, Path("data")) == {"data/render": "aa.dir"}


def test_a_lock_file_that_is_being_written_is_read_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    lock = tmp_path / "dvc.lock"
    lock.write_text("stages:\n  render:\n    outs: [{path: data")
    whole = "stages:\n  render:\n    outs:\n    - {path: data/render, md5: aa.dir}\n"
    monkeypatch.setattr(dvc_lock.time, "sleep", lambda seconds: lock.write_text(whole))
    assert locked_hashes(lock, Path("data")) == {"data/render": "aa.dir"}


def test_a_lock_file_that_stays_unreadable_does_not_stop_a_training(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    lock = tmp_path / "dvc.lock"
    lock.touch()
    monkeypatch.setattr(dvc_lock.time, "sleep", lambda seconds: None)
    assert locked_hashes(lock, Path("data")) == {}
    assert "cannot be read" in caplog.text
