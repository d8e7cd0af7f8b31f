"""The complete pipeline at a small size, by the tutorial's commands, for E and for a network of the
paper."""

import json
import re
import shutil
from functools import partial
from pathlib import Path

import mlflow
import pytest

from tests.pipeline.conftest import ROOT, Run, cloned, commit, copy_tracked, replace_in, run_in
from tests.pipeline.tutorial import blocks, change_settings, write_own_files


@pytest.fixture(scope="module")
def clone(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A clone with a tutorial's files and settings, and one more variant."""
    folder = cloned(tmp_path_factory.mktemp("tutorial"))
    write_own_files(folder / "mine")
    change_settings(folder / "params.yaml", variants=["e", "d_noise_real"])
    commit(folder)
    return folder


@pytest.fixture(scope="module")
def run(clone: Path) -> Run:
    return partial(run_in, clone)


@pytest.fixture(scope="module")
def printed(run: Run) -> str:
    """What the tutorial's commands print, one after another."""
    printed = ""
    for block in blocks("bash"):
        done = run("bash", "-ec", block)
        assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]
        printed += done.stdout + done.stderr
    return printed


@pytest.fixture(scope="module")
def finished(clone: Path, printed: str) -> Path:
    return clone


def test_the_tutorials_files_are_there(finished: Path, printed: str) -> None:
    assert "set camera.view_deg to 71.5" in printed
    for name in ("look.jpg", "backgrounds.jpg", "reports/e/figures/predictions.jpg"):
        assert (finished / name).stat().st_size > 10_000
    assert (finished / "found/predictions.jsonl").read_text().count("\n") == 1


def test_a_log_holds_no_progress_bars(printed: str) -> None:
    assert "60 images are in data/render/images" in printed
    assert "%|" not in printed


def test_the_report_has_a_row_for_each_variant_and_the_constant(finished: Path) -> None:
    report = json.loads((finished / "reports/ablation.json").read_text())
    rows = report["rows"]
    names = [(row["variant"], row["refinement"]) for row in rows]
    assert names == [("e", ""), ("e", "fit"), ("d_noise_real", "")]
    assert all(row["silhouettes"] for row in rows)
    assert {(row["test_images"], row["steps"]) for row in rows} == {(6, 6)}
    assert report["constant"]["x_mm"] > 0
    text = (finished / "reports/ablation.md").read_text()
    assert "stand-in" in text
    assert "| E + fit |" in text
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
    assert runs.keys() == {"e", "d_noise_real", "detector"}
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


def test_a_changed_variant_runs_its_training_alone(finished: Path, run: Run) -> None:
    replace_in(finished / "conf/variant/d_noise_real.yaml", "noise: 10", "noise: 5")
    result = run("dvc", "repro", "--dry")
    replace_in(finished / "conf/variant/d_noise_real.yaml", "noise: 5", "noise: 10")
    stages = re.findall(r"Running stage '([^']+)'", result.stdout)
    # A dry run cannot know that the new model will differ: later stages are not listed.
    assert stages == ["train@d_noise_real"]


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


def test_predict_writes_a_line_of_json_and_draws(finished: Path, run: Run) -> None:
    image = next((finished / "data/real/images").glob("*.jpg"))
    result = run(
        "shaftpose", "predict", str(image), "--model", "models/d_noise_real/model.onnx",
        "--score", "0", "--out", "found_d", "--draw",
    )  # fmt: skip
    assert result.returncode == 0, result.stderr
    line = json.loads((finished / "found_d/predictions.jsonl").read_text())
    assert line["image"] == str(image)
    assert {"score", "box", "x_mm", "y_mm", "z_mm", "pitch_deg", "yaw_deg"} <= set(
        line["instruments"][0]
    )
    assert (finished / "found_d" / image.name).is_file()


def test_show_draws_sheets(finished: Path, run: Run) -> None:
    for what, folder in (("dataset", "data/render/images"), ("backgrounds", "data/backgrounds")):
        result = run("shaftpose", "show", what, folder, "--out", f"{what}.jpg", "--count", "4")
        assert result.returncode == 0, result.stderr
        assert (finished / f"{what}.jpg").stat().st_size > 10_000
    missing = run("shaftpose", "show", "dataset", "nowhere", "--out", "x.jpg")
    assert missing.returncode == 1
    assert missing.stderr.startswith("error: nowhere")


# The last test: it leaves the experiment's results in place of the pipeline's.
def test_an_experiment_trains_again_what_differs_and_is_compared(finished: Path, run: Run) -> None:
    shards = sorted((finished / "data/render").rglob("*.tar"))
    before = [shard.stat().st_mtime_ns for shard in shards]
    page = (finished / "docs/sweeps.md").read_text()
    (block,) = re.findall(r"^```\n(dvc exp run .+?)```", page, re.MULTILINE | re.DOTALL)
    experiment, _, show, plots = block.splitlines()  # the second one runs on without end
    replace_in(finished / "params.yaml", "variants: [e, ", "variants: [")  # E reads no alpha
    commit(finished)
    done = run("bash", "-ec", experiment)
    assert done.returncode == 0, done.stderr[-3000:]
    stages = "train", "export", "evaluate", "evaluate_real"
    ran = re.findall(r"^Running stage '(\w+)@d_noise_real'", done.stdout, re.MULTILINE)
    assert sorted(ran) == sorted(stages)
    assert [shard.stat().st_mtime_ns for shard in shards] == before
    # These networks find nothing, so that errors are missing: the project's own have them all.
    shutil.copy(ROOT / "reports/metrics.json", finished / "reports")
    shown = run("bash", "-ec", show).stdout.splitlines()
    assert max(map(len, shown)) <= 120
    assert shown[1].split() == [
        "Experiment", "mAP", "x_mm", "y_mm", "z_mm", "tip_mm", "axis_deg", "iou",
        "params.yaml:loss.alpha",
    ]  # fmt: skip
    assert [line.split()[-1] for line in shown[3:6]] == ["0.5", "1.5", "0.5"]
    assert "index.html" in run("bash", "-ec", plots).stdout
