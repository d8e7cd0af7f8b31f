"""The report that compares evaluated trainings."""

import shutil
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest

from shaftpose.core.errors import InputError
from shaftpose.core.files import read_json, write_json
from shaftpose.core.images import write_jpeg
from shaftpose.stage_files import STAND_IN, AboutImages, read_training
from shaftpose.tracking.trainings import run_of
from studies.compare_runs import compare

ROOT = Path(__file__).parents[2]


@pytest.fixture
def folders(training: Path, store: Path) -> list[Path]:
    """Two evaluated trainings of one variant, in a project with its settings."""
    for name in ("conf", "params.yaml"):
        (store / name).symlink_to(ROOT / name)
    write_json(store / "data/real/about.json", asdict(AboutImages(STAND_IN)))
    write_jpeg(np.zeros((8, 8, 3), np.uint8), training / "predictions.jpg")
    other = training.with_name("other")
    shutil.copytree(training, other)
    return [training, other]


def test_each_folder_has_a_row_named_after_it(folders: list[Path], tmp_path: Path) -> None:
    run = run_of(read_training(folders[0], "").training_id, "d")
    compare([*folders, folders[0]], tmp_path / "report")  # one twice: one row
    rows = read_json(tmp_path / "report/ablation.json", "")["rows"]
    assert [row["variant"].partition(" ")[2] for row in rows] == [str(each) for each in folders]
    assert [row["settings"] for row in rows] == 2 * [{"noise": 10, "start": True}]
    page = (tmp_path / "report/ablation.html").read_text()
    assert all(str(each) in page for each in folders)
    assert page.count(f"/runs/{run}") == 2  # both are of this training


def test_a_folder_without_results_is_named(folders: list[Path], tmp_path: Path) -> None:
    (folders[1] / "evaluation.json").unlink()
    with pytest.raises(InputError, match=r"other/evaluation\.json: missing; run .*evaluate"):
        compare(folders, tmp_path / "report")
    assert not (tmp_path / "report").exists()
