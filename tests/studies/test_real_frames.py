"""The command that measures models on real frames, its record of test runs, and the page."""

import json
import shutil
from dataclasses import replace
from datetime import date
from pathlib import Path

import numpy as np
import pytest

from shaftpose.core.errors import InputError
from shaftpose.core.images import write_jpeg
from shaftpose.evaluation.frame_results import FrameResults
from shaftpose.export.onnx_export import store_metadata
from shaftpose.image_files.reading import read_rgb
from shaftpose.inference.model_files import ModelMetadata
from shaftpose.inference.predictor import Predictor
from shaftpose.metrics.detection.precision_recall import PrecisionRecall
from shaftpose.stage_files import read_stage_file
from studies import real_frames
from studies.choose_for_frames import best_mean_f1, choose, take_edge_reader
from studies.frame_tables import frame_blocks, runs_sentence
from studies.real_frames import Run, Runs, label, measure, runs_of
from studies.write_results_page import REAL, real_images
from tests.conftest import SCORES, SIDE, constant_edge_reader

ROOT = Path(__file__).parents[2]
# The first detection of `constant_model`, and its tip.
BOX, TIP = [10, 20, 100, 200], [156, 136]


@pytest.fixture
def model(constant_model: Path) -> str:
    store_metadata(constant_model, ModelMetadata(0.5, 95.0, 3.0, 150.0, "flat"))
    return str(constant_model)


@pytest.fixture
def data(tmp_path: Path) -> Path:
    """A folder whose parts show one shaft in the first of two frames, of two operations."""
    folder = tmp_path / "data"
    x, y, width, height = BOX
    corners = [x, y, x + width, y, x + width, y + height, x, y + height]
    frames = [
        {"id": n, "file_name": f"{name}.jpg", "width": SIDE, "height": SIDE, "operation": name}
        for n, name in enumerate("ab")
    ]
    attributes = {"tip": TIP, "tail": [115, 198]}
    shafts = [{"image_id": 0, "bbox": BOX, "segmentation": [corners], "attributes": attributes}]
    for name in "ab":
        write_jpeg(np.full((SIDE, SIDE, 3), 120, np.uint8), folder / "images" / f"{name}.jpg")
    for part in ("validation", "test"):
        content = {"images": frames, "annotations": shafts}
        (folder / f"{part}.json").write_text(json.dumps(content))
    return folder


def results(path: Path) -> FrameResults:
    return read_stage_file(path, FrameResults, "measure it")


def test_results_name_the_model_the_part_and_both_digests(
    model: str, data: Path, tmp_path: Path
) -> None:
    path = measure(data, "validation", model, tmp_path / "real")
    found = results(path)
    assert path.name == f"{label(model, found.sha256)}-validation.json"
    assert path.name.startswith("constant-")
    assert (found.model, found.part, found.threshold) == (model, "validation", 0.5)
    assert (len(found.sha256), len(found.digest)) == (64, 16)
    counts = found.groups["all"].counts
    assert (counts.frames, counts.operations, counts.shafts) == (2, 2, 1)
    metrics = found.groups["all"].metrics
    # The box is right in one frame and false in the other.
    assert (metrics["box_recall"].value, metrics["box_precision"].value) == (1, 0.5)
    assert metrics["empty_detected"].value == 1
    assert not (tmp_path / "real/runs.json").exists()


def test_squares_of_tissue_show_how_often_something_is_found_where_nothing_is(
    model: str, data: Path, tmp_path: Path
) -> None:
    with pytest.raises(InputError, match=r"backgrounds: holds no OPERATION/\*\.jpg; run shaftpose"):
        measure(data, "tissue", model, tmp_path / "reports/real")
    for place in ("a/1.jpg", "a/2.jpg", "b/1.jpg"):
        write_jpeg(np.full((SIDE, SIDE, 3), 120, np.uint8), data / "backgrounds" / place)
    path = measure(data, "tissue", model, tmp_path / "reports/real")
    every = results(path).groups["all"]  # a constant model finds something everywhere
    assert (every.counts.frames, every.counts.operations, every.counts.shafts) == (3, 2, 0)
    assert every.metrics["empty_detected"].value == 1
    name = path.stem.removesuffix("-tissue")
    block = frame_blocks(tmp_path)
    assert "**Squares of tissue, without a tool**" in block
    row = [line for line in block.splitlines() if line.startswith(f"| {name} ")][-1]
    assert [cell.strip() for cell in row.split("|")[2:5]] == ["3", "2", "3"]


def test_a_threshold_is_chosen_by_the_validation_part(model: str, data: Path) -> None:
    first, second = SCORES[:2]
    assert Predictor(Path(model)).confidence not in SCORES
    choice = choose(Path(model), data)  # the first detection is right, the second is not
    assert second < choice.threshold == pytest.approx(first)
    assert choice.frame_px is None  # the model takes images of one size
    assert Predictor(Path(model)).confidence == choice.threshold


def test_all_measures_choose_the_threshold() -> None:
    """F1 of boxes: 2/3, 1; of axes, which alone would choose the other score: 2/3, 1/2."""
    scores, recall = np.array([0.9, 0.6]), np.array([0.5, 1.0])
    boxes = PrecisionRecall(recall, np.ones(2), scores)
    axes = PrecisionRecall(np.array([0.5, 0.5]), np.array([1.0, 0.5]), scores)
    assert best_mean_f1([boxes, axes], otherwise=0.3) == (pytest.approx(0.75), 0.6)
    assert best_mean_f1([axes], otherwise=0.3) == (pytest.approx(2 / 3), 0.9)
    none = PrecisionRecall(np.zeros(2), np.zeros(2), scores)
    assert best_mean_f1([none, none], otherwise=0.3) == (0.0, 0.3)


def test_a_model_takes_the_edge_reader_of_another_one(model: str, tmp_path: Path) -> None:
    own, reader = Predictor(Path(model)).metadata, constant_edge_reader(2.0, 0.0)
    other = Path(shutil.copy(model, tmp_path / "other.onnx"))
    store_metadata(other, replace(own, confidence=0.7, edge_reader=reader))
    take_edge_reader(Path(model), other)
    assert Predictor(Path(model)).metadata == replace(own, edge_reader=reader)
    store_metadata(other, own)
    with pytest.raises(InputError, match=r"other\.onnx: has no edge reader; name a model of"):
        take_edge_reader(Path(model), other)


def test_the_test_part_is_run_once(model: str, data: Path, tmp_path: Path) -> None:
    records = tmp_path / "real"
    path = measure(data, "test", model, records)
    found = results(path)
    run = Run(model, found.sha256, found.digest, date.today().isoformat())
    assert runs_of(records) == Runs((run,))
    with pytest.raises(InputError, match=r"-test\.json: holds the results .* run once"):
        measure(data, "test", model, records)
    measure(data, "validation", model, records)  # as often as one likes
    path.unlink()
    measure(data, "test", model, records)
    assert runs_of(records) == Runs((run, run))


def test_results_of_other_frames_are_kept(model: str, data: Path, tmp_path: Path) -> None:
    records = tmp_path / "real"
    path = measure(data, "test", model, records)
    before = path.read_bytes()
    write_jpeg(np.full((SIDE, SIDE, 3), 130, np.uint8), data / "images/a.jpg")
    with pytest.raises(InputError, match=r"-test\.json: holds .* on other frames; .*--out"):
        measure(data, "test", model, records)
    assert path.read_bytes() == before and len(runs_of(records).test) == 1
    store_metadata(Path(model), ModelMetadata(0.6, 95.0, 3.0, 150.0, "flat"))
    measure(data, "test", model, records)
    first, second = runs_of(records).test
    assert first.sha256 != second.sha256 and first.digest != second.digest


def test_shafts_without_masks_are_refused(model: str, data: Path, tmp_path: Path) -> None:
    path = data / "validation.json"
    path.write_text(path.read_text().replace('"segmentation"', '"other"'))
    with pytest.raises(InputError, match=r"has no pixel in `segmentation`"):
        measure(data, "validation", model, tmp_path / "real")


def test_only_public_frames_are_drawn(
    model: str, data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    measure(data, "validation", model, tmp_path / "real")
    assert not (tmp_path / "real/gallery.jpg").exists()
    public = {"validation.json": {"images": [{"file_name": "images/b.jpg"}]}}
    monkeypatch.setattr(real_frames, "annotations", public.__getitem__)
    measure(data, "validation", model, tmp_path / "real")
    assert read_rgb(tmp_path / "real/gallery.jpg").shape[2] == 3


def test_models_are_told_apart_by_their_files() -> None:
    assert label("laparoscopy", "0123456789") == "laparoscopy-01234567"
    assert label("models/e real.onnx", "0123456789") == "e_real-01234567"
    assert label("mlflow:/shafts@best", "0123456789") == "shafts_best-01234567"


def test_the_page_says_how_often_the_test_part_was_run() -> None:
    run = Run("m.onnx", "0123456789", "d", "2026-11-27")
    assert runs_sentence(Runs()) == "The test part was run 0 times."
    assert runs_sentence(Runs((run,))) == "The test part was run once: m-01234567 on 2026-11-27."
    assert runs_sentence(Runs((run, run))).startswith("The test part was run 2 times: m-0")


def test_the_page_shows_each_model_and_group(model: str, data: Path, tmp_path: Path) -> None:
    assert frame_blocks(tmp_path).startswith("No model was measured yet.")
    name = measure(data, "test", model, tmp_path / "reports/real").stem.removesuffix("-test")
    block = frame_blocks(tmp_path)
    assert block.startswith(f"The test part was run once: {name} on ")
    lines = [[cell.strip() for cell in line.split("|")[1:-1]] for line in block.splitlines()]
    boxes = [line for line in lines if line[:2] == [name, "all"]][0]
    # The false detection is in none, one or both of the frames of a resample of two operations.
    assert boxes[3:] == [
        "1", "1.000 (1.00 to 1.00)", "0.000 (0.00 to 0.00)", "1.000 (1.00 to 1.00)",
        "0.500 (0.00 to 1.00)",
    ]  # fmt: skip
    assert "The validation part" not in block
    assert "Worst frames" not in block


def test_the_committed_page_shows_the_records() -> None:
    assert real_images(ROOT) == REAL.read_text(), "run `make results`"
