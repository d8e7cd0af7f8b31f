"""An exported model whose convolutions compute in 8 bits, which is faster."""

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

from shaftpose.files import new_file


def quantise(model: Path, out: Path, images: NDArray[np.uint8]) -> None:
    """Write a copy of an exported model with 8-bit convolutions, ranges of whose inputs and outputs
    are those on images (N, S, S, 3) of its training.

    The first convolution, the last ones, whose outputs are decoded, and the decoding stay as they
    are, and so do the model's facts.
    """
    with TemporaryDirectory() as folder, new_file(out) as part:
        prepared = Path(folder) / "prepared.onnx"
        quant_pre_process(str(model), str(prepared), skip_symbolic_shape=True)
        quantize_static(
            str(prepared),
            str(part),
            _Images(images),
            quant_format=QuantFormat.QDQ,
            op_types_to_quantize=["Conv"],
            nodes_to_exclude=outer_convolutions(onnx.load(str(prepared)).graph),
            per_channel=True,
            # Signed inputs are no faster than float32 in onnxruntime on x86.
            activation_type=QuantType.QUInt8,
            weight_type=QuantType.QInt8,
        )
        written = onnx.load(str(part))
        onnx.helper.set_model_props(
            written, {fact.key: fact.value for fact in onnx.load(str(model)).metadata_props}
        )
        onnx.save(written, str(part), format="protobuf")


def outer_convolutions(graph: GraphProto) -> list[str]:
    """The names of the first convolution, and of those from which no other convolution takes its
    input, directly or through other nodes."""
    names, leading = [], set[str]()  # leading: values from which a convolution follows
    first = next(node.name for node in graph.node if node.op_type == "Conv")
    for node in reversed(graph.node):  # nodes stand after those whose outputs they take
        leads = not leading.isdisjoint(node.output)
        if node.op_type == "Conv" and (node.name == first or not leads):
            names.append(node.name)
        if node.op_type == "Conv" or leads:
            leading.update(node.input)
    return names


class _Images(CalibrationDataReader):
    """Gives the quantizer one image after the other."""

    def __init__(self, images: NDArray[np.uint8]) -> None:
        self._images = iter(images)

    def get_next(self) -> dict[str, NDArray[np.uint8]] | None:
        image = next(self._images, None)
        return None if image is None else {"image": image[None]}
