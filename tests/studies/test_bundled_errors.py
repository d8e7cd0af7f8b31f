"""What is measured of a bundled model on new renders, with a model whose answer is known."""

from dataclasses import asdict
from pathlib import Path

import pytest

from shaftpose.core.errors import InputError
from shaftpose.core.files import write_json
from shaftpose.core.shard_writer import ShardWriter, shard_name
from shaftpose.dataset.split import Split, write_split
from shaftpose.export.onnx_export import store_metadata
from shaftpose.inference.model_files import ModelMetadata, bundled_model, checksum
from shaftpose.inference.predictor import Predictor
from shaftpose.training.fingerprint import rendered_digest
from studies.bundled_errors import RECORDS, BundledErrors, check, measured, recorded, table
from tests.evaluations import METRICS
from tests.studies.conftest import SHAFT, sample


@pytest.fixture
def renders(tmp_path: Path) -> Path:
    """Two images that show a shaft in the first of `BOXES`."""
    with ShardWriter(tmp_path / shard_name(0), 95) as shard:
        for n in range(2):
            shard.write(sample(n, SHAFT))
    return tmp_path


def test_all_images_are_measured(constant_model: Path, renders: Path) -> None:
    store_metadata(constant_model, ModelMetadata(0.5, 95.0, 3.0))
    metrics = measured(Predictor(constant_model), renders)
    assert tuple(metrics[name] for name in ("images", "instruments", "confidence")) == (2, 2, 0.5)
    values = [metrics[name] for name in ("detected_rate", "x_mm", "tip_mm")]
    assert values == pytest.approx([1.0, 0.5, 0.5])
    lines = table({**metrics, "images": 1000, "mAP": 0.9}).splitlines()
    assert lines[:2] == [
        "On 1,000 other renders, with 2 shafts. Errors are means over",
        "the shafts that were found, with a score of at least 0.500.",
    ]
    assert lines[-1] == "| 0.900 | 1.000 | 0.50 | 0.00 | 0.00 | 0.00 | 0.00 | 0.00 | 0.50 |"


def test_images_of_the_training_are_refused(renders: Path, tmp_path: Path) -> None:
    split, card = tmp_path / "split", tmp_path / "card.md"
    card.write_text("- data `0123456789abcdef`")
    check(renders, split, card)
    write_split(Split(["0"], ["1"], ["2"]), split)
    check(renders, split, card)
    card.write_text(f"- data `{rendered_digest(renders, split)}`")
    with pytest.raises(InputError, match=f"^{renders}: the images of the model's training, by "):
        check(renders, split, card)


def test_a_record_of_another_model_is_refused(constant_model: Path, tmp_path: Path) -> None:
    path = tmp_path / RECORDS / "shaftpose.json"
    with pytest.raises(InputError, match="run `python -m studies.bundled_errors`"):
        recorded(tmp_path)
    own = {**METRICS, "mAP": 0.9}
    write_json(path, asdict(BundledErrors(checksum(bundled_model()).decode(), own)))
    assert recorded(tmp_path) == own
    write_json(path, asdict(BundledErrors(checksum(constant_model).decode(), own)))
    with pytest.raises(InputError, match=f"^{path}: measured of another model than the bundled"):
        recorded(tmp_path)
