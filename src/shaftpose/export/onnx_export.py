"""Export of a detector to one ONNX file, including decoding and non-maximum suppression."""

import logging
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from copy import deepcopy
from itertools import pairwise
from pathlib import Path
from typing import Any, TypeVar

import onnx
import torch
from onnxscript import opset20
from torch import Tensor, nn
from torch.nn.utils import fuse_conv_bn_eval

from shaftpose.core.files import new_file
from shaftpose.inference.learned_edges import OUTPUTS, STRIPS
from shaftpose.inference.model_files import ModelMetadata
from shaftpose.network.pose_network import MaskNetwork, PoseNetwork, normalise_images
from shaftpose.network.ssd.decoding import NMS_OPERATOR
from shaftpose.network.ssd.layers import ConvBNReLU
from shaftpose.refinement.contour_sampling import COLUMNS, ROWS
from shaftpose.settings.schema import DetectionSettings

OPSET = 20
# `opset20` accepts Python numbers and lists, but its type hints refuse them.
op: Any = opset20
Module = TypeVar("Module", bound=nn.Module)


class ShaftDetector(nn.Module):
    """A network and the decoding of its outputs: images in, instruments out."""

    def __init__(self, network: PoseNetwork, limits: DetectionSettings) -> None:
        super().__init__()
        self.network = network
        self.limits = limits

    @property
    def output_names(self) -> tuple[str, ...]:
        """The names of the tensors that `forward` returns."""
        masks = ("mask", "tool") if isinstance(self.network, MaskNetwork) else ()
        return ("boxes", "scores", "poses", *masks)

    def forward(self, image: Tensor) -> tuple[Tensor, ...]:
        """(N, H, W, 3) uint8 RGB -> boxes (N, K, 4), scores (N, K), poses (N, K, 5).

        K is `limits.max_detections`. Boxes in pixels, poses in mm and deg, best score first, padded
        with zeros. For networks that predict them, also two masks (N, H, W), see `MaskNetwork`.
        """
        outputs = self.network(normalise_images(image))
        decoded = self.network.detections(outputs, self.limits)
        if isinstance(self.network, MaskNetwork):
            return (*decoded, *self.network.masks(outputs))
        return decoded


def export_onnx(detector: ShaftDetector, path: Path, side_px: int) -> None:
    """Write a detector to one file with input `image` and the detector's outputs.

    The number of images stays dynamic, and their size if the network takes any. The detector is
    exported in evaluation mode, on the CPU.
    """
    exported = with_folded_norms(detector.cpu().eval())
    # Two images: an example of one would fix the batch dimension to one.
    example = torch.zeros(2, side_px, side_px, 3, dtype=torch.uint8)
    # The exporter finds the least sizes itself; with `Dim`s it would trace once more for them.
    names = ["batch", "height", "width"] if exported.network.takes_any_size else ["batch"]
    with _quiet():
        program = torch.onnx.export(
            exported,
            (example,),
            dynamo=True,
            opset_version=OPSET,
            input_names=["image"],
            output_names=list(exported.output_names),
            dynamic_shapes={"image": dict(enumerate(names))},
            custom_translation_table={NMS_OPERATOR: _onnx_nms_mask},
            verbose=False,
        )
    assert program is not None
    with new_file(path) as part:
        program.save(part, external_data=False)


def edge_reader_bytes(reader: nn.Module) -> bytes:
    """An edge reader as an ONNX model, for any number of strips."""
    example = torch.zeros(2, 3, ROWS, COLUMNS)
    with _quiet():
        program = torch.onnx.export(
            reader.cpu().eval(),
            (example,),
            dynamo=True,
            opset_version=OPSET,
            input_names=[STRIPS],
            output_names=OUTPUTS,
            dynamic_shapes={"strips": {0: "parts"}},
            verbose=False,
        )
    assert program is not None
    return program.model_proto.SerializeToString()


def store_metadata(path: Path, metadata: ModelMetadata) -> None:
    """Replace the metadata of an exported file."""
    model = onnx.load(str(path))
    onnx.helper.set_model_props(model, metadata.as_text())
    with new_file(path) as part:
        onnx.save(model, str(part), format="protobuf")


def with_folded_norms(module: Module) -> Module:
    """A copy in which each batch normalisation is part of the convolution before it.

    The exporter does this itself in the end, but takes half as long again for the larger network.
    Elsewhere than in these modules, children need not run one after another; subclasses of the
    normalisation may do more.
    """
    folded = deepcopy(module)
    for part in folded.modules():
        if not isinstance(part, nn.Sequential | ConvBNReLU):
            continue
        for (before, conv), (after, norm) in pairwise([*part.named_children()]):
            if isinstance(conv, nn.Conv2d) and type(norm) is nn.BatchNorm2d:
                setattr(part, before, fuse_conv_bn_eval(conv, norm))
                setattr(part, after, nn.Identity())
    return folded


def _onnx_nms_mask(boxes: Any, scores: Any, iou_threshold: float) -> Any:
    """`nms_mask` by ONNX's NonMaxSuppression: boxes (B, K, 4), scores (B, K) -> (B, K).

    ONNX orders corners as `y, x`, which does not change the IoU.
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
    """Hide the exporter's warnings about its own internals."""
    previous = logging.root.manager.disable
    logging.disable(logging.WARNING)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        logging.disable(previous)
