"""Choose by real frames the size at which a model sees them, and its confidence threshold.

`python -m studies.choose_for_frames models/e_real/model.onnx --data FOLDER` takes the frames of
`FOLDER/validation.json` from `shaftpose real fetch`. It stores in the file the shorter side of what
the network sees of a frame, and the threshold, that together have the best mean F1 of boxes, masks
and axes: there are too few shafts to choose by one of them alone. The threshold replaces the one
that the export has chosen by rendered images. With `--edge-reader-of`, the model first takes the
edge reader of another one: trained with sharp renders alone, a reader is more exact.
"""

import argparse
import shutil
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import numpy as np

from shaftpose.core.errors import InputError, exit_on_input_error
from shaftpose.dataset.coco import read_coco
from shaftpose.dataset.coco_images import CocoImage
from shaftpose.evaluation.frame_results import compared_frames
from shaftpose.evaluation.whole_frames import FrameModel
from shaftpose.export.onnx_export import store_metadata
from shaftpose.inference.model_files import ModelMetadata
from shaftpose.inference.predictor import Predictor
from shaftpose.metrics.detection.precision_recall import PrecisionRecall, f1_scores
from shaftpose.metrics.frames.ranking import Ranked

SIDES_PX = 200, 240, 270, 299
MEASURES = "box", "mask", "axis"


class Choice(NamedTuple):
    """Mean F1 on the validation frames, the shorter side that the model sees of them, None if
    its size is fixed, and the confidence threshold."""

    f1: float
    frame_px: int | None
    threshold: float


def main() -> None:
    """Store the choice for the command line's model."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("model", type=Path, help="an exported file")
    parser.add_argument("--data", type=Path, required=True, help="of `shaftpose real fetch`")
    parser.add_argument(
        "--edge-reader-of", type=Path, metavar="MODEL", help="exported file with a better one"
    )
    options = parser.parse_args()
    with exit_on_input_error():
        if options.edge_reader_of is not None:
            take_edge_reader(options.model, options.edge_reader_of)
        best = choose(options.model, options.data)
        print(f"{options.model}: stored {best.frame_px} px and threshold {best.threshold:.3f}")


def take_edge_reader(model: Path, other: Path) -> None:
    """Replace a model's edge reader by that of another one. Raises InputError if it has none."""
    reader = Predictor(other).metadata.edge_reader
    if reader is None:
        raise InputError(f"{other}: has no edge reader; name a model of variant e or e_real")
    store_metadata(model, replace(Predictor(model).metadata, edge_reader=reader))


def choose(model: Path, data: Path) -> Choice:
    """Choose size and threshold, and store them: the best choice."""
    predictor, images = Predictor(model), read_coco(data / "validation.json")
    sides: Sequence[int | None] = (None,) if predictor.frame_px is None else SIDES_PX
    best = max(_tried(predictor, model, images, side) for side in sides)
    store_metadata(model, _with(predictor, best.frame_px, best.threshold))
    return best


def _tried(
    predictor: Predictor, model: Path, images: Sequence[CocoImage], side_px: int | None
) -> Choice:
    """The best threshold of the model at one size."""
    with TemporaryDirectory() as scratch:
        copy = Path(shutil.copy(model, scratch))
        store_metadata(copy, _with(predictor, side_px, predictor.confidence))
        frames = compared_frames(FrameModel(str(copy)), images)
    curves = [Ranked(frames, kind, None).curve(np.ones(len(frames))) for kind in MEASURES]
    f1, threshold = best_mean_f1(curves, otherwise=predictor.confidence)
    print(f"{side_px} px: mean F1 {f1:.3f} at threshold {threshold:.3f}")
    return Choice(f1, side_px, threshold)


def best_mean_f1(curves: Sequence[PrecisionRecall], otherwise: float) -> tuple[float, float]:
    """The best mean F1 of curves of the same detections, and its threshold; `otherwise`, if all
    detections are false by all of them."""
    f1 = np.mean([f1_scores(curve) for curve in curves], axis=0)
    if not f1.any():
        return 0.0, otherwise
    best = int(f1.argmax())
    return float(f1[best]), float(curves[0].scores[best])


def _with(predictor: Predictor, side_px: int | None, threshold: float) -> ModelMetadata:
    metadata = replace(predictor.metadata, frame_px=side_px)
    if predictor.refiner is None:
        return replace(metadata, confidence=threshold)
    return replace(metadata, fit_confidence=threshold)


if __name__ == "__main__":
    main()
