"""Smaller copies of an exported model: weights stored in 16 bits, or computation in 8 bits."""

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import onnx
from numpy.typing import NDArray
from onnx import GraphProto, ModelProto, NodeProto, TensorProto, helper, numpy_helper
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


def with_half_weights(model: ModelProto) -> ModelProto:
    """Copy an exported model at half the size: weights of convolutions are stored as float16, and
    all computation stays in float32.

    A Cast converts the weights back. onnxruntime applies it once, when it loads the file, so the
    copy is as fast as the model. Biases and decoding stay float32. The exporter's metadata of nodes
    is removed, because it names files of the exporting machine.
    """
    copy = ModelProto()
    copy.CopyFrom(model)
    graph = copy.graph
    weights = {node.input[1] for node in graph.node if node.op_type == "Conv"}
    casts = [_halve(stored) for stored in graph.initializer if stored.name in weights]
    nodes = [*casts, *graph.node]
    del graph.node[:]
    graph.node.extend(nodes)
    for noted in (graph, *graph.node, *graph.value_info, *graph.input, *graph.output):
        del noted.metadata_props[:]
    onnx.checker.check_model(copy)
    return copy


def _halve(stored: TensorProto) -> NodeProto:
    """Store a float32 tensor as float16 under another name. Returns the Cast to its old name."""
    name = stored.name
    half = numpy_helper.to_array(stored).astype(np.float16)
    stored.CopyFrom(numpy_helper.from_array(half, f"{name}.half"))
    return helper.make_node("Cast", [stored.name], [name], f"{name}.cast", to=TensorProto.FLOAT)


def quantise(model: Path, out: Path, images: NDArray[np.uint8]) -> None:
    """Write a copy of an exported model whose convolutions compute in 8 bits.

    images: (N, S, S, 3) uint8, some of the training images, on which the ranges of all values are
    measured. The first convolution, those whose outputs are decoded, the decoding and the metadata
    stay as they are.
    """
    with TemporaryDirectory() as folder, new_file(out) as part:
        prepared = Path(folder) / "prepared.onnx"
        quant_pre_process(str(model), str(prepared), skip_symbolic_shape=True)
        with np.errstate(invalid="ignore"):  # in ranges of decoded values, which are not used
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
        stated = {entry.key: entry.value for entry in onnx.load(str(model)).metadata_props}
        store_metadata(part, ModelMetadata.from_text(stated))


def inner_nodes(graph: GraphProto) -> list[str]:
    """The names of the nodes to quantise: all those on a path to a convolution, except the first
    convolution."""
    first = next(node.name for node in graph.node if node.op_type == "Conv")
    names, leading = [], set[str]()  # leading: values on a path to a convolution
    for node in reversed(graph.node):  # a node stands after those whose outputs it takes
        leads = not leading.isdisjoint(node.output)
        if leads and node.op_type in _KINDS and node.name != first:
            names.append(node.name)
        if leads or node.op_type == "Conv":
            leading.update(node.input)
    return names


class _Images(CalibrationDataReader):
    """Passes images to the quantizer one by one."""

    def __init__(self, images: NDArray[np.uint8]) -> None:
        self._images = iter(images)

    def get_next(self) -> dict[str, NDArray[np.uint8]] | None:
        image = next(self._images, None)
        return None if image is None else {"image": image[None]}
