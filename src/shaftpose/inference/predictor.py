"""Runs an exported model and refines its poses: images in, detections out."""

import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from shaftpose.core.errors import InputError
from shaftpose.core.geometry import Camera, axis_direction, pose_along
from shaftpose.core.instruments import Detections, unpadded
from shaftpose.inference.backends import open_network
from shaftpose.inference.learned_edges import LearnedEdges
from shaftpose.inference.model_files import SIDES_PX, ModelMetadata, bundled_names
from shaftpose.inference.symmetric_views import found_in_views
from shaftpose.refinement.contour import Shaft
from shaftpose.refinement.refiner import Refiner
from shaftpose.settings.choices import Backend, Refinement

_OUTPUTS, _MASK, _TOOL = ["boxes", "scores", "poses"], "mask", "tool"
_MOST = 10_000  # detections in an image
_PROBE_PX = 64  # side of an image on which a model of any size is tried


class Predictor:
    """Runs an ONNX file of the export stage, and refines its poses.

    refine: see `settings.choices`. backend: runs the model; onnxruntime always runs its edge
    reader. refiner: None if poses are not fitted: without a mask, for an instrument from a CAD
    file, for a distorting lens, or if `refine` is `none` or `views`.
    The model is run once on a black image. Raises InputError naming the file if it is missing or
    not such a model, or naming the backend if it is not installed.
    """

    def __init__(
        self, path: Path, refine: Refinement = "edges", backend: Backend = "onnxruntime"
    ) -> None:
        if not path.is_file():
            raise InputError(
                f"{path}: no such file; export it, or name a model of the package: "
                f"{', '.join(bundled_names())}"
            )
        self._network = open_network(path, backend)
        names = self._network.outputs
        if names not in (_OUTPUTS, [*_OUTPUTS, _MASK], [*_OUTPUTS, _MASK, _TOOL]):
            raise InputError(f"{path}: its outputs are {names}; use a model of the export stage")
        self._path = path
        try:
            self.metadata = ModelMetadata.from_text(self._network.metadata)
        except ValueError as error:
            raise InputError(f"{path}: its metadata are damaged ({error}); export again") from error
        self._check_run()
        self._in_views = refine == "views"
        has_mask = _MASK in names
        self.refiner = self._create_refiner(refine) if has_mask else None
        # Whether poses would be fitted if the camera and shaft of the training were others.
        self.cannot_fit = has_mask and refine in ("mask", "edges") and self.refiner is None

    @property
    def side_px(self) -> int:
        """The side of the square images that the model was trained on."""
        return self._network.side_px or self.metadata.side_px

    @property
    def frame_px(self) -> int | None:
        """The shorter side of the image that the model sees of a whole frame; None: it takes square
        images of one size alone, or was trained with lens distortion, so that its poses hold for
        squares of its own camera."""
        if self._network.side_px or self.metadata.distorted:
            return None
        return self.metadata.frame_px or self.side_px

    @property
    def confidence(self) -> float:
        """The confidence threshold for this predictor's scores, chosen on validation images.

        Raises InputError naming the file if it states none.
        """
        stated, lacks = self.metadata, "confidence threshold; export it again or set one"
        threshold = stated.confidence if self.refiner is None else stated.fit_confidence
        if self._in_views:
            threshold = stated.views_confidence
            lacks = (
                "confidence threshold for means over views; export it with detection.refine=views, "
                "or set one (--score; detection.confidence_threshold)"
            )
        if threshold is None:
            raise InputError(f"{self._path}: holds no {lacks}")
        return threshold

    @property
    def refines(self) -> bool:
        """Whether poses are other than those of one run of the network."""
        return self._in_views or self.refiner is not None

    @property
    def fits_edges(self) -> bool:
        """Whether poses are fitted to the edges of images."""
        return self.refiner is not None and self.refiner.edges is not None

    @property
    def camera(self) -> Camera:
        """The camera that the model was trained for."""
        return Camera.from_field_of_view(self.side_px, self.side_px, self.metadata.view_deg)

    def __call__(
        self,
        images: NDArray[np.uint8],
        fine: Sequence[NDArray[np.uint8] | None] | None = None,
        camera: Camera | None = None,
    ) -> list[Detections]:
        """The detections in each of the images (N, H, W, 3) uint8 RGB, best score first.

        fine: the same images in more pixels, (k H, k W, 3), or None where there are none, for the
        fit. camera: the pinhole camera that sees the images, by default one of the model's focal
        length whose axis meets their centre. Raises InputError naming the file and the image if an
        output is NaN or infinite.
        """
        masks = None
        if self._in_views:
            found = found_in_views(self._found, images)
        elif self.refiner is None:
            found = self._found(images)
        else:
            *outputs, masks = self._run([*_OUTPUTS, _MASK], images)
            found = list(self._unpadded(*outputs))
        if camera is not None:
            found = [_seen_by(camera, self.camera, each) for each in found]
        if self.refiner is None or masks is None:
            return found
        if camera is None:
            height, width = images.shape[1:3]
            camera = Camera(width, height, self.camera.focal_px, width / 2, height / 2)
        masks = self._averaged(self._finite(masks), images)
        inputs = zip(images, masks, found, fine or [None] * len(images), strict=True)
        return [self.refiner(rgb, mask, each, camera, finer) for rgb, mask, each, finer in inputs]

    def _found(self, images: NDArray[np.uint8]) -> list[Detections]:
        """The detections of one run of the network."""
        return list(self._unpadded(*self._run(_OUTPUTS, images)))

    def _averaged(
        self, masks: NDArray[np.float32], images: NDArray[np.uint8]
    ) -> NDArray[np.float32]:
        """The means of masks (N, H, W) of images (N, H, W, 3) and of those of the images turned by
        180 deg: test-time augmentation, measured in docs/real_images.md."""
        turned = self.masks(np.ascontiguousarray(images[:, ::-1, ::-1]))
        return (masks + turned[:, ::-1, ::-1]) / 2

    def masks(self, images: NDArray[np.uint8]) -> NDArray[np.float32]:
        """The masks (N, H, W), probabilities of a shaft, of images (N, H, W, 3) uint8 RGB, from a
        model that predicts them, by one run of the network. Raises InputError naming the file and
        the image if one is not finite."""
        return self._finite(*self._run([_MASK], images))

    def _run(self, outputs: Sequence[str], images: NDArray[np.uint8]) -> list[NDArray[np.float32]]:
        """The values of outputs, whose shapes have been checked."""
        try:
            found = self._network.run(outputs, images)
        except Exception as error:  # the backends' own exceptions have no common base
            cause = " ".join(str(error).split())
            raise InputError(f"{self._path}: cannot be run; export it again: {cause}") from error
        shapes = dict(zip(outputs, (values.shape for values in found), strict=True))
        count, height, width, _ = images.shape
        places = count, *(shapes.get("scores", ())[1:2] or (0,))
        expected = {"boxes": (*places, 4), "scores": places, "poses": (*places, 5)}
        for name, shape in shapes.items():
            if shape != expected.get(name, (count, height, width)) or places[1] > _MOST:
                raise InputError(
                    f"{self._path}: output {name} has the shape {list(shape)}; use a model of the "
                    "export stage"
                )
        return found

    def _check_run(self) -> None:
        side_px = self._network.side_px or _PROBE_PX
        if not SIDES_PX[0] <= side_px <= SIDES_PX[1]:
            raise InputError(
                f"{self._path}: takes images of {side_px} px a side; use a model of the export "
                "stage"
            )
        self._run(self._network.outputs, np.zeros((1, side_px, side_px, 3), np.uint8))

    def tools(self, images: NDArray[np.uint8]) -> NDArray[np.float32] | None:
        """As `masks`, the probabilities of any part of an instrument; None if the model predicts
        none."""
        if _TOOL not in self._network.outputs:
            return None
        return self._finite(*self._run([_TOOL], images))

    def _finite(self, masks: NDArray[np.float32]) -> NDArray[np.float32]:
        for number in np.flatnonzero(~np.isfinite(masks).all(axis=(1, 2))):
            raise InputError(
                f"{self._path}: image {number} of a batch: the model finds a mask that is not "
                "finite: export it again, or train it again"
            )
        return masks

    def _unpadded(self, *outputs: NDArray[np.floating]) -> Iterator[Detections]:
        for number in range(len(outputs[0])):
            try:
                yield from unpadded(*(values[number : number + 1] for values in outputs))
            except InputError as error:
                raise InputError(f"{self._path}: image {number} of a batch: {error}") from error

    def _create_refiner(self, refine: Refinement) -> Refiner | None:
        diameter_mm, length_mm = self.metadata.shaft_diameter_mm, self.metadata.shaft_length_mm
        if diameter_mm is None or length_mm is None or self.metadata.distorted:
            return None
        if refine in ("none", "views"):
            return None
        shaft = Shaft(diameter_mm, length_mm, flat_tip=self.metadata.shaft_tip == "flat")
        edges = self._edges() if refine == "edges" else None
        return Refiner(shaft, edges, self.metadata.pitches_deg)

    def _edges(self) -> LearnedEdges:
        reader = self.metadata.edge_reader
        if reader is None:
            raise InputError(
                f"{self._path}: holds no edge reader: export it again, or fit poses to its mask "
                "alone (--refine mask; detection.refine: mask)"
            )
        try:
            return LearnedEdges(reader)
        except Exception as error:  # onnxruntime's own exceptions have no common base
            raise InputError(f"{self._path}: its edge reader is damaged; export again") from error

    def frames_per_second(self, image: NDArray[np.uint8], repetitions: int = 30) -> float:
        """Images per second at batch size 1: median of `repetitions` calls after 3 warm-up calls.

        image: (S, S, 3) uint8 RGB.
        """
        seconds = []
        for _ in range(repetitions + 3):
            start = time.perf_counter()
            self(image[None])
            seconds.append(time.perf_counter() - start)
        return float(1 / np.median(seconds[3:]))


def _seen_by(camera: Camera, reference: Camera, found: Detections) -> Detections:
    """The poses for a camera of those that the reference camera would see at the same pixels.

    The network knows no camera: it states poses for its training images' focal length and a camera
    whose axis meets the image's centre. `network.dense.coding.reference_points` is the inverse.
    """
    aside = np.array([camera.cx - camera.width / 2, camera.cy - camera.height / 2])
    linear = np.diag([1.0, 1.0, camera.focal_px / reference.focal_px])
    linear[:2, 2] = -aside / reference.focal_px
    poses = found.poses.copy()
    for row, pose in enumerate(poses):
        axis = linear @ axis_direction(pose[3], pose[4])
        poses[row] = pose_along(axis / np.linalg.norm(axis), linear @ pose[:3]).as_array()
    return replace(found, poses=poses)


def raw_and_refined_predictors(path: Path, refine: Refinement) -> list[Predictor]:
    """The model without refinement and, if its poses can be refined so, with it."""
    refining = Predictor(path, refine)
    return [Predictor(path, "none"), *([refining] if refining.refines else [])]
