"""Edges of a shaft in an image, found by a model's edge reader."""

import numpy as np
from numpy.typing import NDArray

from shaftpose.core.errors import InputError
from shaftpose.inference.sessions import open_session
from shaftpose.refinement.contour import Contour
from shaftpose.refinement.contour_sampling import COLUMNS, MIDDLE, ROWS, outline_strips
from shaftpose.refinement.edges import Offsets

STRIPS, OUTPUTS = "strips", ["offsets", "log_scales"]
_LEAST_ERROR = 0.05  # columns: lower bound of the errors that the reader states
# Measured (docs/beyond.md): the reader understates offsets where it is unsure; all are enlarged.
_OFFSET_GAIN = 1.25


class LearnedEdges:
    """A model's edge reader (`network.dense.edge_reader`), from an ONNX model in bytes.

    Raises onnxruntime's exceptions if the bytes are not a model, and ValueError if the model is not
    an edge reader.
    """

    def __init__(self, network: bytes) -> None:
        self._session = open_session(network, threads=1)  # strips are too small to share
        takes = {each.name: each.shape[1:] for each in self._session.get_inputs()}
        gives = [each.name for each in self._session.get_outputs()]
        if takes != {STRIPS: [3, ROWS, COLUMNS]} or gives != OUTPUTS:
            raise ValueError(f"an edge reader takes {takes} and gives {gives}")
        self.read(np.zeros((1, ROWS, COLUMNS, 3), np.float32))

    def read(self, colours: NDArray[np.float32]) -> list[NDArray[np.float32]]:
        """Offsets, in columns, and the logarithms of their mean errors, (P, ROWS) each, of strips
        (P, ROWS, COLUMNS, 3) in [-1, 1]. Raises InputError if they are not finite."""
        strips = np.ascontiguousarray(colours.transpose(0, 3, 1, 2))
        read = self._session.run(OUTPUTS, {STRIPS: strips})
        for values in read:
            if values.shape != colours.shape[:2] or not np.isfinite(values).all():
                raise InputError("the edge reader gives no finite offsets and errors: export again")
        return read

    def __call__(self, rgb: NDArray[np.float32], contour: Contour, reach_px: float) -> Offsets:
        """The edges of an image (H, W, 3) in [-1, 1] within `reach_px` of the contour."""
        step_px = reach_px / MIDDLE
        strips = outline_strips(rgb, contour, step_px)
        offsets, errors = (strips.of_samples(values) for values in self.read(strips.colours))
        variance = 2 * step_px**2 * (np.exp(2 * errors) + _LEAST_ERROR**2)  # of Laplace errors
        return Offsets(_OFFSET_GAIN * step_px * offsets, strips.inside / variance)
