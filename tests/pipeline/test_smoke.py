"""The complete pipeline at a small size, for a network of the paper; test_tutorial.py has E."""

import json
import re
from pathlib import Path

import mlflow
import numpy as np
import pytest

from shaftpose.core.geometry import Camera, ShaftPose
from shaftpose.frame_sources.video_files import VideoFile
from tests.pipeline.conftest import Run, commit, copy_tracked, replace_in


@pytest.fixture(scope="module")
def finished(clone: Path, run: Run) -> Path:
    result = run("dvc", "repro")
    assert result.returncode == 0, result.stdout[-3000:] + result.stderr[-3000:]
    return clone


def test_report_has_a_row_for_the_variant_and_the_constant(finished: Path) -> None:
    report = json.loads((finished / "reports/ablation.json").read_text())
    (row,) = report["rows"]
    assert (row["variant"], row["refined"]) == ("d_noise_real", False)
    assert row["silhouettes"]
    assert (row["test_images"], row["steps"]) == (6, 6)
    assert report["constant"]["x_mm"] > 0
    text = (finished / "reports/ablation.md").read_text()
    assert "stand-in" in text
    assert "0.965" in text  # the paper's mAP of D + noise + real, next to ours


def test_split_is_nine_to_one_and_shares_no_background(finished: Path) -> None:
    from shaftpose.core.shards import ShardedDataset
    from shaftpose.dataset.split import read_keys

    shards = ShardedDataset(finished / "data/render/images")
    keys = {
        part: read_keys(finished / "data/split", part) for part in ("train", "validation", "test")
    }
    sources = {
        part: {shards.scene_description(key)["source"] for key in found}
        for part, found in keys.items()
    }
    assert len(keys["test"]) == 6
    assert len(keys["train"]) + len(keys["validation"]) == 54
    assert not sources["test"] & (sources["train"] | sources["validation"])
    assert not sources["train"] & sources["validation"]


def test_the_data_card_describes_what_was_validated(finished: Path) -> None:
    card = finished / "reports/data_card"
    sets = json.loads((card / "metrics.json").read_text())
    assert {name: found["images"] for name, found in sets.items()} == {
        "images": 60, "clear": 2, "occluded": 2,
    }  # fmt: skip
    assert sets["images"]["quantities"]["silhouette_iou"]["min"] > 0.95
    pictures = re.findall(r"\]\((.+)\)", (card / "data_card.md").read_text())
    assert pictures
    assert all((card / name).stat().st_size > 10_000 for name in pictures)
    sources = json.loads((finished / "data/validation/sources.json").read_text())
    assert len(sources) == 60


def test_a_variant_is_tracked_with_model_and_metrics(finished: Path) -> None:
    mlflow.set_tracking_uri(f"sqlite:///{finished / 'mlflow.db'}")
    found = mlflow.search_runs(experiment_names=["shaftpose"], output_format="list")
    (parent,) = [run for run in found if "shaftpose.repro" in run.data.tags]
    files = mlflow.MlflowClient().list_artifacts(parent.info.run_id)
    assert {"ablation.html", "params.yaml"} == {one.path for one in files}
    runs = {run.info.run_name: run for run in found if run is not parent}
    assert runs.keys() == {"d_noise_real", "detector"}
    for run in runs.values():
        assert run.data.tags["mlflow.parentRunId"] == parent.info.run_id
    data = runs["d_noise_real"].data
    assert data.params["loss.alpha"] == "1.5"
    assert data.params["loss.beta.z_mm"] == "2.0"
    assert re.fullmatch(r"[0-9a-f]{32}(\.dir)?", data.tags["dataset.data/render"])
    assert {"test/mAP", "train/loss", "test/rendered/clear/iou"} <= data.metrics.keys()
    assert any(name.startswith("system/") for name in data.metrics)
    client = mlflow.MlflowClient()
    assert client.get_registered_model("shaftpose").aliases.keys() == {"candidate"}
    model = mlflow.onnx.load_model("models:/shaftpose@candidate")
    assert [output.name for output in model.graph.output][:3] == ["boxes", "scores", "poses"]


def test_second_run_does_nothing(finished: Path, run: Run) -> None:
    result = run("dvc", "repro")
    assert "Running stage" not in result.stdout
    assert "up to date" in result.stdout


def test_a_fresh_clone_of_what_git_holds_runs_nothing(
    finished: Path, run: Run, tmp_path: Path
) -> None:
    """Lock file, metrics and code show that the results are up to date; data are not needed."""
    copy_tracked(finished, tmp_path)
    commit(tmp_path)
    assert not (tmp_path / "data/render").exists()
    result = run("dvc", "--cd", str(tmp_path), "repro", "--dry", "--allow-missing")
    assert result.returncode == 0, result.stderr
    assert "Running stage" not in result.stdout
    assert "up to date" in result.stdout


def test_changed_alpha_trains_again_but_does_not_render(finished: Path, run: Run) -> None:
    shards = sorted((finished / "data/render").rglob("*.tar"))
    before = [shard.stat().st_mtime_ns for shard in shards]
    replace_in(finished / "params.yaml", "alpha: 1.5", "alpha: 0.5")
    result = run("dvc", "repro", "train@d_noise_real")
    replace_in(finished / "params.yaml", "alpha: 0.5", "alpha: 1.5")
    restored = run("dvc", "repro", "train@d_noise_real")
    assert "is cached - skipping run" in restored.stdout
    assert "Running stage 'train@d_noise_real'" in result.stdout
    assert "Running stage 'render'" not in result.stdout
    assert [shard.stat().st_mtime_ns for shard in shards] == before


def test_a_changed_variant_runs_its_training_alone(finished: Path, run: Run) -> None:
    replace_in(finished / "conf/variant/d_noise_real.yaml", "noise: 10", "noise: 5")
    result = run("dvc", "repro", "--dry")
    replace_in(finished / "conf/variant/d_noise_real.yaml", "noise: 5", "noise: 10")
    stages = re.findall(r"Running stage '([^']+)'", result.stdout)
    # A dry run cannot know that the new model will differ: later stages are not listed.
    assert stages == ["train@d_noise_real"]


def test_experiments_are_compared_within_a_terminals_width(finished: Path, run: Run) -> None:
    lock = (finished / "dvc.lock").read_bytes()
    replace_in(finished / "params.yaml", "alpha: 1.5", "alpha: 0.5")
    saved = run("dvc", "exp", "save", "--force", "--name", "adjective-noun")
    replace_in(finished / "params.yaml", "alpha: 0.5", "alpha: 1.5")
    (finished / "dvc.lock").write_bytes(lock)  # in which DVC has noted the experiment
    assert saved.returncode == 0, saved.stderr[-3000:]
    page = (finished / "docs/sweeps.md").read_text()
    (command,) = re.findall("^dvc exp show .+$", page, re.MULTILINE)
    shown = run("bash", "-ec", command).stdout.splitlines()
    assert max(map(len, shown)) <= 120
    assert shown[1].split() == [
        "Experiment", "mAP", "x_mm", "y_mm", "z_mm", "tip_mm", "axis_deg", "iou",
        "params.yaml:loss.alpha",
    ]  # fmt: skip
    assert [line.split()[-1] for line in shown[3:6]] == ["1.5", "1.5", "0.5"]


@pytest.fixture(scope="module")
def swept(finished: Path, run: Run) -> str:
    """What a sweep of two trainings printed; their folders are in sweeps/alpha."""
    sweep = ["variant=c", "loss.alpha=0.5,2.0", "hydra.sweep.dir=sweeps/alpha"]
    result = run("python", "pipelines/train.py", "-m", *sweep)
    assert result.returncode == 0, result.stderr[-3000:]
    return result.stdout


def test_sweep_nests_its_runs_and_leaves_outputs_alone(
    finished: Path, run: Run, swept: str
) -> None:
    assert "at full length: python pipelines/train.py variant=c loss.alpha=" in swept
    assert (finished / "sweeps/alpha/sweep_lines.png").is_file()
    mlflow.set_tracking_uri(f"sqlite:///{finished / 'mlflow.db'}")
    runs = mlflow.search_runs(experiment_names=["shaftpose alpha"], output_format="list")
    parents = [run for run in runs if "shaftpose.sweep" in run.data.tags]
    assert len(parents) == 1
    children = [r for r in runs if r.data.tags.get("mlflow.parentRunId") == parents[0].info.run_id]
    names = ["c  alpha=0.5", "c  alpha=2.0"]
    assert sorted(child.info.run_name for child in children) == names
    assert run("dvc", "status", "train@d_noise_real").stdout.strip() == (
        "Data and pipelines are up to date."
    )


def test_trainings_of_a_sweep_are_recorded_at_the_confidence_of_their_models(
    finished: Path, run: Run, swept: str
) -> None:
    replace_in(finished / "params.yaml", "confidence_threshold: null", "confidence_threshold: 0.99")
    result = run("python", "-m", "studies.evaluate_trainings", "sweeps/alpha/0")
    replace_in(finished / "params.yaml", "confidence_threshold: 0.99", "confidence_threshold: null")
    assert result.returncode == 0, result.stderr[-3000:]
    (name,) = re.findall(r"^recorded in (reports/trainings/c-7-\w+\.json)$", result.stdout, re.M)
    record = json.loads((finished / name).read_text())
    assert record["row"]["steps"] == 6
    assert record["recipe"]["detection"]["confidence_threshold"] is None
    assert 0 < record["row"]["metrics"]["confidence"] < 0.99
    where = ["sweeps/alpha/0", "--out", "reports/again"]
    compared = run("python", "-m", "studies.compare_runs", *where)
    assert compared.returncode == 0, compared.stderr[-3000:]
    rows = json.loads((finished / "reports/again/ablation.json").read_text())["rows"]
    assert [row["variant"] for row in rows] == ["c sweeps/alpha/0"]
    assert rows[0]["settings"]["loss.alpha"] == 0.5


def test_predict_writes_a_line_of_json_and_draws(finished: Path, run: Run) -> None:
    image = next((finished / "data/real/images").glob("*.jpg"))
    result = run(
        "shaftpose", "predict", str(image), "--model", "models/d_noise_real/model.onnx",
        "--score", "0", "--out", "found", "--draw",
    )  # fmt: skip
    assert result.returncode == 0, result.stderr
    line = json.loads((finished / "found/predictions.jsonl").read_text())
    assert line["image"] == str(image)
    assert {"score", "box", "x_mm", "y_mm", "z_mm", "pitch_deg", "yaw_deg"} <= set(
        line["instruments"][0]
    )
    assert (finished / "found" / image.name).is_file()


def test_show_draws_sheets(finished: Path, run: Run) -> None:
    for what, folder in (("dataset", "data/render/images"), ("backgrounds", "data/backgrounds")):
        result = run("shaftpose", "show", what, folder, "--out", f"{what}.jpg", "--count", "4")
        assert result.returncode == 0, result.stderr
        assert (finished / f"{what}.jpg").stat().st_size > 10_000
    missing = run("shaftpose", "show", "dataset", "nowhere", "--out", "x.jpg")
    assert missing.returncode == 1
    assert missing.stderr.startswith("error: nowhere")


def test_a_film_of_moving_shafts_is_rendered(finished: Path, run: Run) -> None:
    result = run("python", "-m", "studies.moving_shafts", "film", "--frames", "2")
    assert result.returncode == 0, result.stderr
    first, second = VideoFile(finished / "film/film.mp4").frames()
    assert (first.fps, first.rgb.shape) == (25.0, (360, 640, 3))
    poses = json.loads((finished / "film/poses.json").read_text())
    assert [len(shafts) for shafts in poses] == [2, 2]
    # Between the frames, pixels change around the shafts only.
    changed = np.abs(first.rgb.astype(int) - second.rgb).max(axis=2) > 30
    camera = Camera.from_field_of_view(640, 640, 95.0)
    lines = [
        camera.project(pose.tip_mm + length_mm * pose.direction) - (0, (640 - 360) / 2)
        for pose in (ShaftPose(**stated) for stated in poses[0])
        for length_mm in np.linspace(0, 20, 41)
    ]
    y, x = np.nonzero(changed)
    assert len(x) > 20
    distances = np.linalg.norm(np.stack([x, y], axis=1)[:, None] - np.array(lines), axis=2)
    assert np.mean(distances.min(axis=1) < 40) > 0.9
