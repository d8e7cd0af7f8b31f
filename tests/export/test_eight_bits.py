"""Models whose convolutions compute in 8 bits."""

from pathlib import Path

import numpy as np
import onnx
import pytest
from onnx import ModelProto, TensorProto, helper, numpy_helper

from shaftpose.export.eight_bits import inner_nodes, quantise
from shaftpose.export.onnx_export import store_metadata
from shaftpose.inference.backends import open_network
from shaftpose.inference.model_files import ModelMetadata

RNG = np.random.default_rng(0)
SIDE, CHANNELS = 16, 4
INPUTS = {
    "stem": 3,
    "deep": CHANNELS,
    "deeper": CHANNELS,
    "head": 2 * CHANNELS,
    "early head": CHANNELS,
}


@pytest.fixture
def model() -> ModelProto:
    """A first convolution, two more, joined, and a head after the first and after both."""
    nodes = [
        helper.make_node("Cast", ["image"], ["grey"], to=TensorProto.FLOAT),
        helper.make_node("Transpose", ["grey"], ["planes"], perm=[0, 3, 1, 2]),
        helper.make_node("Mul", ["planes", "scale"], ["small"]),
        *_conv("stem", "small"),
        *_conv("deep", "stem"),
        *_conv("deeper", "deep"),
        helper.make_node("Concat", ["deeper", "deep"], ["joined"], "joined", axis=1),
        *_conv("head", "joined"),
        *_conv("early head", "stem"),
        helper.make_node("Concat", ["head", "early head"], ["found"], "decoded", axis=1),
    ]
    weights = {
        name: RNG.normal(size=(CHANNELS, inputs, 1, 1)) / 2 for name, inputs in INPUTS.items()
    }
    stored = [numpy_helper.from_array(v.astype(np.float32), f"{n} w") for n, v in weights.items()]
    stored.append(numpy_helper.from_array(np.float32(1 / 255), "scale"))
    image = helper.make_tensor_value_info("image", TensorProto.UINT8, ["N", SIDE, SIDE, 3])
    found = helper.make_tensor_value_info(
        "found", TensorProto.FLOAT, ["N", 2 * CHANNELS, SIDE, SIDE]
    )  # fmt: skip
    graph = helper.make_graph(nodes, "small", [image], [found], stored)
    return helper.make_model(graph, opset_imports=[helper.make_opsetid("", 20)], ir_version=10)


def _conv(name: str, source: str) -> list[onnx.NodeProto]:
    conv = helper.make_node("Conv", [source, f"{name} w"], [f"{name} sum"], name)
    return [conv, helper.make_node("Relu", [f"{name} sum"], [name])]


def test_the_first_and_the_last_convolutions_are_left_out(model: ModelProto) -> None:
    assert sorted(inner_nodes(model.graph)) == ["deep", "deeper", "joined"]


def test_the_copy_computes_nearly_the_same_and_keeps_the_facts(
    model: ModelProto, tmp_path: Path
) -> None:
    floats, integers = tmp_path / "model.onnx", tmp_path / "model_8bit.onnx"
    onnx.save(model, str(floats))
    facts = ModelMetadata(confidence=0.25, view_deg=70.0, edge_reader=b"bytes")
    store_metadata(floats, facts)
    images = RNG.integers(0, 256, (5, SIDE, SIDE, 3)).astype(np.uint8)
    quantise(floats, integers, images)
    first, second = (open_network(path, "onnxruntime") for path in (floats, integers))
    assert ModelMetadata.from_text(second.metadata) == facts
    (expected,), (found,) = (network.run(["found"], images) for network in (first, second))
    apart = np.abs(found - expected)
    assert 0 < apart.max() < 0.02 * expected.max()  # of 255 steps, two convolutions lose a few
    graph = onnx.load(str(integers)).graph
    made_by = {output: node.op_type for node in graph.node for output in node.output}
    inputs = {
        node.name: {made_by.get(name) for name in node.input}
        for node in graph.node
        if node.op_type in ("Conv", "Concat")
    }
    integer = {name for name, makers in inputs.items() if makers == {"DequantizeLinear"}}
    assert integer == {"deep", "deeper", "joined"}
    assert sorted(path.name for path in tmp_path.iterdir()) == ["model.onnx", "model_8bit.onnx"]
