"""Running an exported model."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import onnx
import pytest
from numpy.typing import NDArray

from shaftpose.core.errors import InputError
from shaftpose.core.geometry import Camera
from shaftpose.export.onnx_export import store_metadata
from shaftpose.inference.loading import load
from shaftpose.inference.model_files import ModelMetadata
from shaftpose.inference.predictor import Predictor, raw_and_refined_predictors
from shaftpose.refinement.refiner import Refiner
from shaftpose.settings.choices import Refinement
from tests.conftest import BOXES, constant_edge_reader, write_constant_model, write_mask_reader
from tests.core.silhouettes import POSES, SHAFT, VIEW_DEG, soft_mask

NEAR_POSE = POSES[:1] + np.array([0.5, -0.4, 1.5, 5.0, -4.0])
ONE_SHAFT = {"boxes": np.array([[1, 2, 3, 4]]), "scores": np.array([0.75]), "poses": NEAR_POSE}
FOCAL_PX = Camera.from_field_of_view(299, 299, VIEW_DEG).focal_px
SHOWN = np.repeat((255 * soft_mask(POSES[0])).astype(np.uint8)[None, ..., None], 3, axis=3)


def test_empty_places_are_left_out(constant_model: Path) -> None:
    found = Predictor(constant_model)(np.zeros((3, 299, 299, 3), dtype=np.uint8))
    assert [image.scores.tolist() for image in found] == [[0.75, 0.25]] * 3
    assert found[2].boxes.tolist() == [[10, 20, 110, 220], [150, 10, 290, 90]]
    assert found[2].poses[1].tolist() == [-8, 5, 31, 55, 350]


def test_outputs_that_are_not_finite_are_named_with_file_and_image(tmp_path: Path) -> None:
    values = {"boxes": BOXES, "scores": [0.75, np.nan, 0.0], "poses": np.zeros((3, 5))}
    path = write_constant_model(tmp_path / "m.onnx", {k: np.array(v) for k, v in values.items()})
    with pytest.raises(InputError, match=rf"^{path}: image 0 of a batch: .* not finite"):
        Predictor(path)(np.zeros((3, 299, 299, 3), dtype=np.uint8))


def test_a_mask_that_is_not_finite_is_named_with_file_and_image(masked_model: Path) -> None:
    spoilt = soft_mask(POSES[0])
    spoilt[7, 9] = np.nan
    write_constant_model(masked_model, {**ONE_SHAFT, "mask": spoilt})
    store_metadata(masked_model, FLAT_ROD)
    predictor, images = Predictor(masked_model), np.zeros((2, 299, 299, 3), dtype=np.uint8)
    for read in (predictor, predictor.masks):
        with pytest.raises(InputError, match=rf"^{masked_model}: image 0 of a batch: .* a mask"):
            read(images)


def test_the_file_keeps_its_confidence(constant_model: Path) -> None:
    store_metadata(constant_model, ModelMetadata(0.1 + 0.2, 95.0, 3.0))
    assert Predictor(constant_model).confidence == 0.1 + 0.2
    store_metadata(constant_model, ModelMetadata(0.5, 95.0, 3.0))
    assert Predictor(constant_model).confidence == 0.5


def test_the_file_states_its_camera_and_its_shaft(constant_model: Path) -> None:
    store_metadata(constant_model, ModelMetadata(0.5, 70.5, 5.0))
    predictor = Predictor(constant_model)
    assert (predictor.metadata.view_deg, predictor.metadata.shaft_diameter_mm) == (70.5, 5.0)
    assert predictor.side_px == 299
    store_metadata(constant_model, ModelMetadata(0.5, 70.5, None))  # an instrument from a CAD file
    assert Predictor(constant_model).metadata.shaft_diameter_mm is None


def test_a_file_that_states_no_camera_has_the_papers(constant_model: Path) -> None:
    predictor = Predictor(constant_model)
    assert (predictor.metadata.view_deg, predictor.metadata.shaft_diameter_mm) == (95.0, None)


def test_a_file_without_confidence_is_named(constant_model: Path) -> None:
    message = r"constant\.onnx: holds no confidence threshold; export it again"
    with pytest.raises(InputError, match=message):
        _ = Predictor(constant_model).confidence


@pytest.mark.parametrize(
    ("stated", "complaint"),
    [
        ({"confidence": "high"}, "high"),
        ({"confidence": "nan"}, "confidence: nan is not from 0 to 1"),
        ({"fit_confidence": "inf"}, "fit_confidence: inf is not from 0 to 1"),
        ({"fit_confidence": "1.5"}, "fit_confidence: 1.5 is not"),
        ({"view_deg": "nan"}, "view_deg: nan is not from 0.1 to 179"),
        ({"view_deg": "180"}, "view_deg: 180 is not"),
        ({"shaft_diameter_mm": "0"}, "shaft_diameter_mm: 0 is not from"),
        ({"shaft_diameter_mm": "1e308"}, r"shaft_diameter_mm: 1e\+308 is not"),
        ({"shaft_length_mm": "-5"}, "shaft_length_mm: -5 is not"),
        ({"side_px": "1000000"}, "side_px: 1000000 is not from 32 to 4096"),
        ({"frame_px": "16"}, "frame_px: 16 is not from 32 to 4096"),
        ({"low_pitch_deg": "90", "high_pitch_deg": "50"}, "low_pitch_deg: is above"),
        ({"distorted": "yes"}, "distorted: 'yes' is neither"),
        ({"shaft_tip": "banana"}, "shaft_tip: 'banana' is none of flat, chamfered"),
        ({"edge_reader": "?"}, "base64"),
    ],
)
def test_damaged_metadata_are_named(
    stated: dict[str, str], complaint: str, constant_model: Path
) -> None:
    model = onnx.load(str(constant_model))
    onnx.helper.set_model_props(model, stated)
    onnx.save(model, str(constant_model))
    with pytest.raises(
        InputError, match=rf"constant\.onnx: its metadata are damaged .*{complaint}"
    ):
        Predictor(constant_model)


VALUES = {"boxes": np.zeros((1, 4)), "scores": np.zeros(1), "poses": np.zeros((1, 5))}


@pytest.mark.parametrize(
    ("changed", "complaint"),
    [
        ({"poses": np.zeros((1, 4))}, r"output poses has the shape \[1, 1, 4\]; use"),
        ({"boxes": np.zeros((2, 4))}, r"output boxes has the shape \[1, 2, 4\]"),
        ({"boxes": np.zeros(4)}, r"output boxes has the shape \[1, 4\]"),
        ({"mask": np.zeros((9, 299))}, r"output mask has the shape \[1, 9, 299\]"),
        ({name: np.repeat(value, 20_000, axis=0) for name, value in VALUES.items()}, ".*20000, 4"),
    ],
)
def test_outputs_of_other_shapes_are_refused(
    changed: dict[str, NDArray[np.float64]], complaint: str, tmp_path: Path
) -> None:
    path = write_constant_model(tmp_path / "m.onnx", VALUES | changed)
    with pytest.raises(InputError, match=f"^{path}: {complaint}"):
        Predictor(path)


def test_images_of_other_types_and_sizes_are_refused(constant_model: Path) -> None:
    model = onnx.load(str(constant_model))
    model.graph.input[0].type.tensor_type.elem_type = onnx.TensorProto.FLOAT
    onnx.save(model, str(constant_model))
    with pytest.raises(InputError, match=r"constant\.onnx: cannot be run; .*input data type"):
        Predictor(constant_model)
    model.graph.input[0].type.tensor_type.shape.dim[1].dim_value = 100_000
    onnx.save(model, str(constant_model))
    with pytest.raises(InputError, match=r"constant\.onnx: takes images of 100000 px a side"):
        Predictor(constant_model)


FLAT_ROD = ModelMetadata(
    0.5, VIEW_DEG, SHAFT.diameter_mm, SHAFT.length_mm, "flat",
    edge_reader=constant_edge_reader(offset=0.0, log_error=0.0),
)  # fmt: skip


def test_poses_are_fitted_to_finer_images_where_there_are_any(masked_model: Path) -> None:
    images = np.repeat(SHOWN, 2, axis=0)
    fine = np.repeat((200 * soft_mask(POSES[0], times=2)).astype(np.uint8)[..., None], 3, axis=2)
    coarse, fitted = Predictor(masked_model)(images, [None, fine])
    assert np.all(fitted.deviations[0] < coarse.deviations[0])
    assert np.all(np.abs(fitted.poses[0] - POSES[0]) < [0.03, 0.03, 0.2, 0.5, 0.2])


@pytest.fixture
def masked_model(tmp_path: Path) -> Path:
    """A model that finds the first of `POSES`, not quite, and takes bright pixels for the mask."""
    path = write_mask_reader(tmp_path / "masked.onnx", ONE_SHAFT)
    store_metadata(path, FLAT_ROD)
    return path


def test_poses_of_a_model_with_a_mask_are_fitted(masked_model: Path) -> None:
    found = Predictor(masked_model, "mask")(np.repeat(SHOWN, 2, axis=0))
    assert len(found) == 2
    assert np.all(np.abs(found[1].poses[0] - POSES[0]) < [0.05, 0.05, 0.3, 0.8, 0.3])
    assert np.all(found[1].boxes[0] > 100)
    alone, fitting = raw_and_refined_predictors(masked_model, "mask")
    assert (alone.refiner, fitting.refiner is None) == (None, False)
    (own,) = alone(np.zeros((1, 299, 299, 3), dtype=np.uint8))
    assert own.boxes.tolist() == [[1, 2, 3, 4]]


def test_the_fitted_mask_is_the_mean_of_those_of_an_image_and_of_it_turned_around(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A network's mask that stays where it is when the image is turned is half as sure."""
    alone = soft_mask(POSES[0])
    path = write_constant_model(tmp_path / "unmoved.onnx", {**ONE_SHAFT, "mask": alone})
    store_metadata(path, FLAT_ROD)
    predictor, given = Predictor(path, "mask"), list[NDArray[np.float32]]()
    assert predictor.refiner is not None
    monkeypatch.setattr(Refiner, "__call__", lambda self, rgb, mask, *rest: given.append(mask))
    predictor(np.repeat(SHOWN, 2, axis=0))
    for mask in given:
        np.testing.assert_allclose(mask, (alone + alone[::-1, ::-1]) / 2, rtol=1e-6)
    assert len(given) == 2


def test_fitted_poses_have_a_threshold_of_their_own(masked_model: Path) -> None:
    alone, fitting = raw_and_refined_predictors(masked_model, "mask")
    assert alone.confidence == 0.5
    with pytest.raises(InputError, match=r"masked\.onnx: holds no confidence threshold"):
        _ = fitting.confidence
    store_metadata(masked_model, replace(FLAT_ROD, fit_confidence=0.25))
    assert [one.confidence for one in raw_and_refined_predictors(masked_model, "mask")] == [
        0.5,
        0.25,
    ]


def test_poses_are_averaged_over_views_without_a_fit(masked_model: Path) -> None:
    alone, averaged = raw_and_refined_predictors(masked_model, "views")
    assert (alone.refiner, averaged.refiner) == (None, None)
    with pytest.raises(InputError, match=r"no confidence threshold for means over views; export"):
        _ = averaged.confidence
    store_metadata(masked_model, replace(FLAT_ROD, views_confidence=0.25))
    averaged = Predictor(masked_model, "views")
    assert averaged.confidence == 0.25
    (found,) = averaged(SHOWN)
    # The model finds the same box near a corner in each of the eight copies.
    assert sorted(found.boxes.tolist()) == [
        [1, 2, 3, 4], [1, 295, 3, 297], [2, 1, 4, 3], [2, 296, 4, 298],
        [295, 1, 297, 3], [295, 296, 297, 298], [296, 2, 298, 4], [296, 295, 298, 297],
    ]  # fmt: skip
    np.testing.assert_allclose(found.scores, 0.75 / 8)
    view = Camera.from_field_of_view(299, 299, 50.0)
    (seen,) = averaged(SHOWN, camera=view)
    np.testing.assert_allclose(seen.poses[:, 2] / found.poses[:, 2], view.focal_px / FOCAL_PX)


@pytest.mark.parametrize(
    "facts",
    [
        replace(FLAT_ROD, shaft_diameter_mm=None, shaft_length_mm=None),  # from a CAD file
        replace(FLAT_ROD, distorted=True),
    ],
)
def test_some_models_with_a_mask_cannot_be_fitted(facts: ModelMetadata, masked_model: Path) -> None:
    store_metadata(masked_model, facts)
    assert Predictor(masked_model).metadata == facts
    refinements: tuple[Refinement, ...] = ("mask", "edges", "none", "views")
    cannot = [Predictor(masked_model, refine).cannot_fit for refine in refinements]
    assert cannot == [True, True, False, False]
    said: list[str] = []
    load(masked_model, warn=said.append)
    assert any("poses are those of the network" in warning for warning in said)
    assert len(raw_and_refined_predictors(masked_model, "edges")) == 1


def test_a_model_without_an_edge_reader_is_fitted_to_its_mask_alone(masked_model: Path) -> None:
    store_metadata(masked_model, replace(FLAT_ROD, edge_reader=None))
    with pytest.raises(InputError, match=r"masked\.onnx: holds no edge reader.*--refine mask"):
        Predictor(masked_model)
    assert not Predictor(masked_model, "mask").fits_edges
    store_metadata(masked_model, replace(FLAT_ROD, edge_reader=b"no model"))
    with pytest.raises(InputError, match=r"masked\.onnx: its edge reader is damaged"):
        Predictor(masked_model)


@pytest.mark.parametrize("content", [None, b"no model"])
def test_what_is_no_model_is_named(content: bytes | None, tmp_path: Path) -> None:
    path = tmp_path / "model.onnx"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(
        InputError,
        match=r"model\.onnx: no(t a readable ONNX| such file; export it, or name a) model",
    ):
        Predictor(path)
