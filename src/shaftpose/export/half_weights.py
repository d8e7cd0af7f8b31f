"""An exported model at half the size: weights stored in 16 bits, all computation in 32."""

import numpy as np
import onnx
from onnx import ModelProto, NodeProto, TensorProto, helper, numpy_helper


def with_half_weights(model: ModelProto) -> ModelProto:
    """A copy of an exported model that stores the weights of its convolutions as float16.

    A Cast converts each back to float32. onnxruntime applies it once, when it loads the file, so
    the copy is as fast as the model. Biases and decoding stay float32. The exporter's metadata of
    nodes is removed, because it names files of the exporting machine.
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
