"""Storing a model's weights in 16 bits."""

import numpy as np
import onnx
import onnxruntime
import pytest
from numpy.typing import NDArray
from onnx import ModelProto, TensorProto, helper, numpy_helper

from shaftpose.export.half_weights import with_half_weights

RNG = np.random.default_rng(0)
WEIGHTS = {
    "first": RNG.normal(size=(3, 2, 3, 3)),
    "bias": RNG.normal(size=3),
    "second": RNG.normal(size=(3, 3, 1, 1)),
    "boxes": RNG.normal(size=(1, 3, 3, 3)),
}
IMAGE = RNG.normal(size=(2, 2, 5, 5)).astype(np.float32)


@pytest.fixture
def model() -> ModelProto:
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


def test_weights_of_convolutions_take_half_the_bytes_and_no_others(model: ModelProto) -> None:
    kinds = {w.name: w.data_type for w in with_half_weights(model).graph.initializer}
    assert kinds == {
        "first.half": TensorProto.FLOAT16,
        "second.half": TensorProto.FLOAT16,
        "bias": TensorProto.FLOAT,
        "boxes": TensorProto.FLOAT,
    }


def test_only_the_weights_are_rounded(model: ModelProto) -> None:
    """The copy computes the same as a model in 32 bits whose weights are rounded to 16 bits."""
    rounded = ModelProto()
    rounded.CopyFrom(model)
    for weight in rounded.graph.initializer:
        if weight.name in ("first", "second"):
            held = numpy_helper.to_array(weight).astype(np.float16).astype(np.float32)
            weight.CopyFrom(numpy_helper.from_array(held, weight.name))
    found = run(with_half_weights(model))
    np.testing.assert_allclose(found, run(rounded), rtol=1e-5, atol=1e-5)
    assert np.abs(found - run(model)).max() > 1e-4


def test_the_model_itself_and_what_it_states_are_kept(model: ModelProto) -> None:
    before = model.SerializeToString()
    copy = with_half_weights(model)
    assert model.SerializeToString() == before
    assert {entry.key: entry.value for entry in copy.metadata_props} == {"confidence": "0.5"}


def test_files_of_the_exporting_machine_are_not_named(model: ModelProto) -> None:
    assert b"/home/me" in model.SerializeToString()
    assert b"/home/me" not in with_half_weights(model).SerializeToString()
    onnx.checker.check_model(with_half_weights(model), full_check=True)
