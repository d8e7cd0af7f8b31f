"""Choose a model's confidence threshold by real frames.

`python -m studies.choose_confidence models/e_real/model.onnx --data FOLDER` takes the frames of
`FOLDER/validation.json` from `shaftpose real fetch`. It stores in the file the threshold with the
best F1 of axes, in place of the one that its export has chosen by rendered images.
"""

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np

from shaftpose.core.errors import exit_on_input_error
from shaftpose.dataset.coco import read_coco
from shaftpose.evaluation.frame_results import compared_frames
from shaftpose.evaluation.whole_frames import FrameModel
from shaftpose.export.onnx_export import store_metadata
from shaftpose.inference.predictor import Predictor
from shaftpose.metrics.detection.precision_recall import best_confidence
from shaftpose.metrics.frames.ranking import Ranked


def main() -> None:
    """Store the threshold of the command line's model."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("model", type=Path, help="an exported file")
    parser.add_argument("--data", type=Path, required=True, help="of `shaftpose real fetch`")
    options = parser.parse_args()
    with exit_on_input_error():
        print(f"{options.model}: confidence threshold {choose(options.model, options.data):.3f}")


def choose(model: Path, data: Path) -> float:
    """Choose the threshold and store it: the threshold."""
    frames = compared_frames(FrameModel(str(model)), read_coco(data / "validation.json"))
    curve = Ranked(frames, "axis", None).curve(np.ones(len(frames)))
    threshold = best_confidence(curve)
    predictor = Predictor(model)
    if predictor.refiner is None:
        metadata = replace(predictor.metadata, confidence=threshold)
    else:
        metadata = replace(predictor.metadata, fit_confidence=threshold)
    store_metadata(model, metadata)
    return threshold


if __name__ == "__main__":
    main()
