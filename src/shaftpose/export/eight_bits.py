"""An exported model whose convolutions compute in 8 bits."""

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import onnx
from numpy.typing import NDArray
from onnx import GraphProto
from onnxruntime.quantization import (
    CalibrationDataReader,
    QuantFormat,
    QuantType,
    quantize_static,
)
from onnxruntime.quantization.shape_inference import quant_pre_process

from shaftpose.core.files import new_file
from shaftpose.export.onnx_export import store_metadata
from shaftpose.inference.model_files import ModelMetadata

# Between two convolutions in 8 bits, these are faster in 8 bits, too.
_KINDS = ["Conv", "Concat", "MaxPool", "AveragePool"]


def quantise(model: Path, out: Path, images: NDArray[np.uint8]) -> None:
    """Write a copy of an exported model that computes in 8 bits, with the ranges that values have
    on images (N, S, S, 3), some of those that it was trained on.

    The first convolution, those whose outputs are decoded, and the decoding stay as they are, and
    so do the model's facts.
    """
    with TemporaryDirectory() as folder, new_file(out) as part:
        prepared = Path(folder) / "prepared.onnx"
        quant_pre_process(str(model), str(prepared), skip_symbolic_shape=True)
        with np.errstate(invalid="ignore"):  # ranges of decoded values, which it does not use
            quantize_static(
                str(prepared),
                str(part),
                _Images(images),
                quant_format=QuantFormat.QDQ,
                op_types_to_quantize=_KINDS,
                nodes_to_quantize=inner_nodes(onnx.load(str(prepared)).graph),
                per_channel=True,
                # Signed inputs are no faster than float32 in onnxruntime on x86.
                activation_type=QuantType.QUInt8,
                weight_type=QuantType.QInt8,
            )
        stated = {fact.key: fact.value for fact in onnx.load(str(model)).metadata_props}
        store_metadata(part, ModelMetadata.from_text(stated))


def inner_nodes(graph: GraphProto) -> list[str]:
    """The names of the nodes to quantise: those from which a convolution follows, directly or
    through other nodes, but for the first convolution."""
    first = next(node.name for node in graph.node if node.op_type == "Conv")
    names, leading = [], set[str]()  # leading: values from which a convolution follows
    for node in reversed(graph.node):  # nodes stand after those whose outputs they take
        leads = not leading.isdisjoint(node.output)
        if leads and node.op_type in _KINDS and node.name != first:
            names.append(node.name)
        if leads or node.op_type == "Conv":
            leading.update(node.input)
    return names


class _Images(CalibrationDataReader):
    """Gives the quantizer one image after the other."""

    def __init__(self, images: NDArray[np.uint8]) -> None:
        self._images = iter(images)

    def get_next(self) -> dict[str, NDArray[np.uint8]] | None:
        image = next(self._images, None)
        return None if image is None else {"image": image[None]}
