"""Copies of models with weights in 16 bits, or with convolutions in 8 bits."""

from pathlib import Path

import numpy as np
import onnx
import onnxruntime
import pytest
from numpy.typing import NDArray
from onnx import ModelProto, TensorProto, helper, numpy_helper

from shaftpose.export.compression import inner_nodes, quantise, with_half_weights
from shaftpose.export.onnx_export import store_metadata
from shaftpose.inference.backends import open_network
from shaftpose.inference.model_files import ModelMetadata

RNG = np.random.default_rng(0)
WEIGHTS = {
    "first": RNG.normal(size=(3, 2, 3, 3)),
    "bias": RNG.normal(size=3),
    "second": RNG.normal(size=(3, 3, 1, 1)),
    "boxes": RNG.normal(size=(1, 3, 3, 3)),
}
IMAGE = RNG.normal(size=(2, 2, 5, 5)).astype(np.float32)
OTHER_RNG = np.random.default_rng(0)  # of the model in 8 bits
SIDE, CHANNELS = 16, 4
INPUTS = {
    "stem": 3,
    "deep": CHANNELS,
    "deeper": CHANNELS,
    "head": 2 * CHANNELS,
    "early head": CHANNELS,
}


@pytest.fixture
def plain() -> ModelProto:
    """Three convolutions, two of which share their weights, then a part that decodes."""
    nodes = [
        helper.make_node("Conv", ["image", "first", "bias"], ["a"], "conv"),
        helper.make_node("Conv", ["a", "second"], ["b"]),
        helper.make_node("Conv", ["b", "second"], ["c"]),
        helper.make_node("Mul", ["c", "boxes"], ["found"]),
    ]
    stored = [numpy_helper.from_array(v.astype(np.float32), name) for name, v in WEIGHTS.items()]
    image = helper.make_tensor_value_info("image", TensorProto.FLOAT, ["N", 2, 5, 5])
    found = helper.make_tensor_value_info("found", TensorProto.FLOAT, ["N", 3, 3, 3])
    graph = helper.make_graph(nodes, "small", [image], [found], stored)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 20)], ir_version=10)
    helper.set_model_props(model, {"confidence": "0.5"})
    model.graph.node[0].metadata_props.add(key="stack_trace", value="/home/me/network.py")
    return model


def run(model: ModelProto) -> NDArray[np.float32]:
    session = onnxruntime.InferenceSession(
        model.SerializeToString(), providers=["CPUExecutionProvider"]
    )
    return np.asarray(session.run(None, {"image": IMAGE})[0])


def test_weights_of_convolutions_take_half_the_bytes_and_no_others(plain: ModelProto) -> None:
    kinds = {w.name: w.data_type for w in with_half_weights(plain).graph.initializer}
    assert kinds == {
        "first.half": TensorProto.FLOAT16,
        "second.half": TensorProto.FLOAT16,
        "bias": TensorProto.FLOAT,
        "boxes": TensorProto.FLOAT,
    }


def test_only_the_weights_are_rounded(plain: ModelProto) -> None:
    """The copy computes the same as a model in 32 bits whose weights are rounded to 16 bits."""
    rounded = ModelProto()
    rounded.CopyFrom(plain)
    for weight in rounded.graph.initializer:
        if weight.name in ("first", "second"):
            held = numpy_helper.to_array(weight).astype(np.float16).astype(np.float32)
            weight.CopyFrom(numpy_helper.from_array(held, weight.name))
    found = run(with_half_weights(plain))
    np.testing.assert_allclose(found, run(rounded), rtol=1e-5, atol=1e-5)
    assert np.abs(found - run(plain)).max() > 1e-4


def test_the_model_itself_and_what_it_states_are_kept(plain: ModelProto) -> None:
    before = plain.SerializeToString()
    copy = with_half_weights(plain)
    assert plain.SerializeToString() == before
    assert {entry.key: entry.value for entry in copy.metadata_props} == {"confidence": "0.5"}


def test_files_of_the_exporting_machine_are_not_named(plain: ModelProto) -> None:
    assert b"/home/me" in plain.SerializeToString()
    assert b"/home/me" not in with_half_weights(plain).SerializeToString()
    onnx.checker.check_model(with_half_weights(plain), full_check=True)


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
        name: OTHER_RNG.normal(size=(CHANNELS, inputs, 1, 1)) / 2 for name, inputs in INPUTS.items()
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


def test_the_copy_computes_nearly_the_same_and_keeps_the_metadata(
    model: ModelProto, tmp_path: Path
) -> None:
    floats, integers = tmp_path / "model.onnx", tmp_path / "model_8bit.onnx"
    onnx.save(model, str(floats))
    metadata = ModelMetadata(confidence=0.25, view_deg=70.0, edge_reader=b"bytes")
    store_metadata(floats, metadata)
    images = OTHER_RNG.integers(0, 256, (5, SIDE, SIDE, 3)).astype(np.uint8)
    quantise(floats, integers, images)
    first, second = (open_network(path, "onnxruntime") for path in (floats, integers))
    assert ModelMetadata.from_text(second.metadata) == metadata
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
