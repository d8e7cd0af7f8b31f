"""Models that need too much time or memory."""

import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper, numpy_helper

from shaftpose.inference.sessions import check_model, open_session

X = {"x": np.zeros((1, 1), np.float32)}


def model(*nodes: onnx.NodeProto) -> bytes:
    """A model from x to y."""
    given, out = (helper.make_tensor_value_info(n, TensorProto.FLOAT, ["N", "M"]) for n in "xy")
    graph = helper.make_graph(nodes, "graph", [given], [out])
    opset = [helper.make_opsetid("", 20)]
    return bytes(helper.make_model(graph, opset_imports=opset, ir_version=10).SerializeToString())


def constant(name: str, *values: object) -> onnx.NodeProto:
    return helper.make_node(
        "Constant", [], [name], value=numpy_helper.from_array(np.array(*values))
    )


def test_a_loop_is_refused() -> None:
    scalar = helper.make_tensor_value_info("go", TensorProto.BOOL, [])
    number = helper.make_tensor_value_info("number", TensorProto.INT64, [])
    values, after = (
        helper.make_tensor_value_info(name, TensorProto.FLOAT, ["N", "M"]) for name in ("a", "b")
    )
    goes_on = helper.make_tensor_value_info("goes_on", TensorProto.BOOL, [])
    body = helper.make_graph(
        [helper.make_node("Identity", ["go"], ["goes_on"]),
         helper.make_node("Identity", ["a"], ["b"])],
        "body", [number, scalar, values], [goes_on, after],
    )  # fmt: skip
    loop = helper.make_node("Loop", ["", "true", "x"], ["y"], body=body)
    with pytest.raises(ValueError, match="it has a loop"):
        open_session(model(constant("true", True), loop))


@pytest.mark.parametrize("node", [b"\x22\x84\x00Loop", b"\xa2\x80\x00\x84\x80\x00Loop"])
def test_a_loop_in_a_longer_encoding_is_refused(node: bytes) -> None:
    with pytest.raises(ValueError, match="it has a loop"):
        check_model(b"\x0a\x10" + node)


def test_too_much_memory_is_refused() -> None:
    many = constant("many", [10**10, 1], np.int64)
    session = open_session(model(many, helper.make_node("ConstantOfShape", ["many"], ["y"])))
    with pytest.raises(Exception, match="memory"):
        session.run(["y"], X)
    kept = open_session(model(helper.make_node("Identity", ["x"], ["y"])))
    assert kept.run(["y"], X)[0].tolist() == [[0.0]]
