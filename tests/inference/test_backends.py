"""Programs that run an exported model."""

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from shaftpose.core.errors import InputError
from shaftpose.inference.backends import open_network, openvino_core
from shaftpose.inference.model_files import bundled_model, bundled_names
from shaftpose.inference.predictor import Predictor
from tests.conftest import BOXES

FRAMES = Path(__file__).parents[1] / "data/bundled_models/shaftpose"


@pytest.fixture(scope="module")
def images() -> NDArray[np.uint8]:
    frames = [cv2.imread(str(path))[..., ::-1] for path in sorted(FRAMES.glob("*.jpg"))]
    return np.ascontiguousarray(np.stack(frames), dtype=np.uint8)


@pytest.mark.parametrize("name", bundled_names())
def test_openvino_finds_what_onnxruntime_finds(name: str, images: NDArray[np.uint8]) -> None:
    path = bundled_model(name)
    one, other = Predictor(path, "none"), Predictor(path, "none", "openvino")
    assert other.metadata == one.metadata
    assert other.side_px == one.side_px
    np.testing.assert_allclose(other.masks(images), one.masks(images), atol=1e-4)
    assert one(images)[0].scores.max() > 0.4
    for known, found in zip(one(images), other(images), strict=True):
        np.testing.assert_allclose(found.scores, known.scores, atol=1e-3)
        np.testing.assert_allclose(found.boxes, known.boxes, atol=0.01)
        np.testing.assert_allclose(found.poses, known.poses, atol=0.01)  # mm and deg


def test_openvino_takes_any_number_of_images(constant_model: Path) -> None:
    predictor = Predictor(constant_model, backend="openvino")
    for count in (3, 1):
        found = predictor(np.zeros((count, 299, 299, 3), dtype=np.uint8))
        assert [image.boxes.tolist() for image in found] == [BOXES[:2]] * count


def test_threads_may_share_openvino(images: NDArray[np.uint8]) -> None:
    network = open_network(bundled_model(), "openvino")
    expected = [network.run(["boxes"], image[None])[0] for image in images]
    with ThreadPoolExecutor(4) as pool:
        found = pool.map(lambda n: network.run(["boxes"], images[n % 3][None])[0], range(12))
        for number, boxes in enumerate(found):
            np.testing.assert_array_equal(boxes, expected[number % 3])


@pytest.mark.parametrize("backend", ["onnxruntime", "openvino"])
def test_a_file_that_is_no_model_is_named(backend: str, tmp_path: Path) -> None:
    path = tmp_path / "model.onnx"
    path.write_text("no model")
    with pytest.raises(InputError, match=f"^{path}: not a readable ONNX model; export it again: "):
        open_network(path, backend)  # type: ignore[arg-type]


def test_openvino_reads_onnx_alone(tmp_path: Path) -> None:
    import openvino

    intermediate = tmp_path / "model.xml"
    openvino.save_model(openvino_core().read_model(bundled_model()), intermediate)
    openvino_core().read_model(intermediate)
    with pytest.raises(InputError, match=f"^{intermediate}: not a readable ONNX model"):
        open_network(intermediate, "openvino")


def test_a_limit_of_threads_that_is_no_number_is_named(
    constant_model: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ORT_INTRA_OP_NUM_THREADS", "all")
    with pytest.raises(InputError, match="^ORT_INTRA_OP_NUM_THREADS=all: not a number"):
        open_network(constant_model, "openvino")
