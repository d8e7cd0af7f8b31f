"""The trained network as one ONNX file, with decoding and non-maximum suppression inside."""

import logging
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import torch
from onnxscript import opset20
from torch import Tensor, nn

from shaftpose.network.decoding import IMAGE_SIDE_PX, DecodedOutputs, decode
from shaftpose.network.shaft_network import ShaftNetwork, normalise_images

OPSET = 20
# Its type hints refuse the Python numbers and lists that it accepts.
op: Any = opset20


class ExportedShaftNetwork(nn.Module):
    """Images in, instruments out: what the ONNX file does."""

    def __init__(self, network: ShaftNetwork, top_k: int, iou_threshold: float, keep: int) -> None:
        super().__init__()
        self.network = network
        self.top_k = top_k
        self.iou_threshold = iou_threshold
        self.keep = keep

    def forward(self, image: Tensor) -> DecodedOutputs:
        """(N, 299, 299, 3) uint8 RGB -> boxes (N, keep, 4), scores (N, keep), poses (N, keep, 5).

        Boxes in pixels, poses in mm and deg, best score first, padded with zeros.
        """
        network = self.network
        outputs = network(normalise_images(image))
        return decode(
            outputs, network.defaults, network.pose_coder,
            self.top_k, self.iou_threshold, self.keep,
        )  # fmt: skip


def export_onnx(
    network: ShaftNetwork,
    path: Path,
    top_k: int = 250,
    iou_threshold: float = 0.5,
    keep: int = 20,
) -> None:
    """Write `network` to one file with input `image` and outputs `boxes`, `scores`, `poses`.

    The number of images is free. The network is exported in evaluation mode, on the CPU.
    """
    exported = ExportedShaftNetwork(network.cpu().eval(), top_k, iou_threshold, keep)
    # Two images: an example of one would fix the batch dimension to one.
    example = torch.zeros(2, IMAGE_SIDE_PX, IMAGE_SIDE_PX, 3, dtype=torch.uint8)
    with _quiet():
        program = torch.onnx.export(
            exported,
            (example,),
            dynamo=True,
            opset_version=OPSET,
            input_names=["image"],
            output_names=["boxes", "scores", "poses"],
            dynamic_shapes={"image": {0: torch.export.Dim("batch")}},
            custom_translation_table={torch.ops.shaftpose.nms_mask.default: _onnx_nms_mask},
            verbose=False,
        )
    assert program is not None
    program.save(path, external_data=False)


def _onnx_nms_mask(boxes: Any, scores: Any, iou_threshold: float) -> Any:
    """`nms_mask` by ONNX's NonMaxSuppression: boxes (B, K, 4), scores (B, K) -> (B, K).

    Its `y, x` order of corners and ours differ, which does not change an overlap.
    """
    limit = op.Shape(scores, start=1, end=2)
    threshold = op.Constant(value_floats=[iou_threshold])
    survivors = op.NonMaxSuppression(boxes, op.Unsqueeze(scores, [1]), limit, threshold)
    image_and_box = op.Gather(survivors, [0, 2], axis=1)
    zeros = op.Expand(0.0, op.Shape(scores))
    ones = op.Expand(1.0, op.Shape(survivors, start=0, end=1))
    return op.ScatterND(zeros, image_and_box, ones)


@contextmanager
def _quiet() -> Iterator[None]:
    """Keep the exporter's warnings about its own internals from the user."""
    previous = logging.root.manager.disable
    logging.disable(logging.WARNING)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        logging.disable(previous)
