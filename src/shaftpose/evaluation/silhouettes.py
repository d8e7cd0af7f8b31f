"""Comparison of a model's poses, as silhouettes, with the masks of images (paper, Table II)."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from shaftpose.core.geometry import Camera
from shaftpose.core.images import Image, write_jpeg
from shaftpose.core.instruments import Detections
from shaftpose.evaluation.masked_images import MaskedImage
from shaftpose.evaluation.results import Silhouettes
from shaftpose.figures.drawing import FOUND, TRUTH, contact_sheet, draw_caption, draw_masks
from shaftpose.inference.predictor import Predictor
from shaftpose.inference.shard_prediction import predict
from shaftpose.metrics.image_metrics import (
    SilhouetteScore,
    image_errors,
    silhouette_iou,
    silhouette_score,
)

DRAWN_IMAGES = 4  # of each set
QUALITY = 85  # of both pictures as JPEG: they are for people
WORST, WORST_COLUMNS = 10, 5  # images of each set with the least IoU

# Poses (N, 5) and a camera -> masks (N, H, W).
Render = Callable[[NDArray[np.float64], Camera], Sequence[NDArray[np.bool_]]]


def compare_silhouettes(
    predictors: Sequence[Predictor],
    confidences: Sequence[float],
    render: Render,
    sets: Mapping[str, Sequence[MaskedImage]],
    folder: Path,
) -> tuple[Silhouettes, dict[str, Path]]:
    """Compare the silhouettes of a model's poses with the masks of each set of images.

    predictors: of raw poses and, if there are any, of refined ones; confidences: their
    confidence thresholds. Returns the scores, and title -> file of two pictures in `folder`: the
    first and the worst images of each set, with the last predictor's poses.
    """
    scores: list[dict[str, SilhouetteScore]] = [{} for _ in predictors]
    first, worst = list[Image](), list[Image]()
    for name, images in sets.items():
        for of_kind, predictor, confidence in zip(scores, predictors, confidences, strict=True):
            found = predict(predictor, (image.rgb for image in images), len(images))
            silhouettes = _silhouettes(images, found, render, confidence)
            overlaps = [
                silhouette_iou(image.masks, masks, image.left_out)
                for image, masks in zip(images, silhouettes, strict=True)
            ]
            of_kind[name] = _score(images, found, overlaps, confidence)
        shown = range(min(DRAWN_IMAGES, len(images)))
        first += [_drawn(images[n], silhouettes[n], name) for n in shown]
        worst += _worst(images, silhouettes, overlaps, name)
    pictures = {name: folder / f"{name}.jpg" for name in ("silhouettes", "worst_silhouettes")}
    write_jpeg(contact_sheet(first, DRAWN_IMAGES), pictures["silhouettes"], QUALITY)
    write_jpeg(contact_sheet(worst, WORST_COLUMNS), pictures["worst_silhouettes"], QUALITY)
    return Silhouettes(*scores), pictures


def _score(
    images: Sequence[MaskedImage],
    found: Sequence[Detections],
    overlaps: Sequence[float | None],
    confidence: float,
) -> SilhouetteScore:
    known = [image.known for image in images]
    axes, cameras = [image.axes for image in images], [image.camera for image in images]
    errors = image_errors(found, known, axes, cameras, confidence)
    return silhouette_score(found, known, overlaps, errors, confidence)


def _silhouettes(
    images: Sequence[MaskedImage], found: Sequence[Detections], render: Render, confidence: float
) -> list[Sequence[NDArray[np.bool_]]]:
    """The masks (H, W) of the poses that were found in each image."""
    pairs = zip(images, tqdm(found, "silhouettes", unit="image", disable=None), strict=True)
    return [render(one.above(confidence).poses, image.camera) for image, one in pairs]


def _worst(
    images: Sequence[MaskedImage],
    silhouettes: Sequence[Sequence[NDArray[np.bool_]]],
    overlaps: Sequence[float | None],
    name: str,
) -> list[Image]:
    """The images with the least IoU, which their captions state, the least first; 1 if there is
    nothing to find, and nothing was found."""
    ious = [1.0 if overlap is None else overlap for overlap in overlaps]
    return [
        _drawn(images[n], silhouettes[n], f"{name} IoU {ious[n]:.2f}")
        for n in sorted(range(len(images)), key=ious.__getitem__)[:WORST]
    ]


def _drawn(image: MaskedImage, silhouettes: Sequence[NDArray[np.bool_]], caption: str) -> Image:
    """The image with its true masks and the silhouettes."""
    outlined = draw_masks(draw_masks(image.rgb, image.masks, TRUTH), silhouettes, FOUND)
    return draw_caption(outlined, caption)
