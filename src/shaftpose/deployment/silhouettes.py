"""Comparison of a model's poses, as silhouettes, with the masks of images (paper, Table II)."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from shaftpose.core.drawing import FOUND, TRUTH, contact_sheet, draw_caption, draw_masks
from shaftpose.core.geometry import Camera
from shaftpose.core.images import Image, write_jpeg
from shaftpose.core.instruments import Detections
from shaftpose.dataset.silhouette_sets import MaskedImage
from shaftpose.deployment.prediction import predict
from shaftpose.deployment.predictor import Predictor
from shaftpose.evaluation.image_axes import image_errors
from shaftpose.evaluation.silhouette_iou import SilhouetteScore, silhouette_score
from shaftpose.handovers import FITTED

DRAWN_IMAGES = 4  # of each set

# Poses (N, 5) and a camera -> masks (N, H, W).
Render = Callable[[NDArray[np.float64], Camera], Sequence[NDArray[np.bool_]]]


def compare_silhouettes(
    predictors: Sequence[Predictor],
    confidences: Sequence[float],
    render: Render,
    sets: Mapping[str, Sequence[MaskedImage]],
    picture: Path,
) -> dict[str, SilhouetteScore]:
    """Detected rate and IoU by set, of a network and, with names that begin with `fitted/`, of its
    fitted poses, each at its own confidence threshold; draws the first images of each set and
    the last predictor's poses."""
    scores, drawn = dict[str, SilhouetteScore](), list[Image]()
    by_prefix = zip(("", FITTED), predictors, confidences, strict=False)
    for prefix, predictor, confidence in by_prefix:
        drawn = []
        for name, images in sets.items():
            found = predict(predictor, (image.rgb for image in images), len(images))
            silhouettes = _silhouettes(images, found, render, confidence)
            scores[f"{prefix}{name}"] = _score(images, found, silhouettes, confidence)
            drawn += _drawn(images, silhouettes, name)
    write_jpeg(contact_sheet(drawn, columns=DRAWN_IMAGES), picture)
    return scores


def _score(
    images: Sequence[MaskedImage],
    found: Sequence[Detections],
    silhouettes: Sequence[Sequence[NDArray[np.bool_]]],
    confidence: float,
) -> SilhouetteScore:
    known, masks = [image.known for image in images], [image.masks for image in images]
    axes, cameras = [image.axes for image in images], [image.camera for image in images]
    errors = image_errors(found, known, axes, cameras, confidence)
    return replace(
        silhouette_score(found, known, masks, silhouettes, confidence),
        tip_px=float(np.median(errors.tip_px)) if len(errors.tip_px) else None,
        axis_deg=float(np.median(errors.axis_deg)) if len(errors.axis_deg) else None,
    )


def _silhouettes(
    images: Sequence[MaskedImage], found: Sequence[Detections], render: Render, confidence: float
) -> list[Sequence[NDArray[np.bool_]]]:
    """The masks (H, W) of the poses that were found in each image."""
    pairs = zip(images, tqdm(found, "silhouettes", unit="image"), strict=True)
    return [render(one.above(confidence).poses, image.camera) for image, one in pairs]


def _drawn(
    images: Sequence[MaskedImage], silhouettes: Sequence[Sequence[NDArray[np.bool_]]], name: str
) -> list[Image]:
    """The first images with their true masks and the silhouettes."""
    return [
        draw_caption(draw_masks(draw_masks(i.rgb, i.masks, TRUTH), silhouette, FOUND), name)
        for i, silhouette in list(zip(images, silhouettes, strict=True))[:DRAWN_IMAGES]
    ]
