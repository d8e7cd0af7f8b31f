"""Fixtures shared by tests of several folders."""

import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper, numpy_helper

from shaftpose.refinement.contour_sampling import COLUMNS, ROWS

if TYPE_CHECKING:
    from shaftpose.network.ssd.pose_bins import BinCoder
    from shaftpose.network.ssd.pose_coding import RegressionCoder
    from shaftpose.network.ssd.single_shot import SingleShotNetwork

SIDE = 299
BOXES = [[10.0, 20.0, 110.0, 220.0], [150.0, 10.0, 290.0, 90.0], [0.0, 0.0, 0.0, 0.0]]
SCORES = [0.75, 0.25, 0.0]
POSES = [[1.0, -2.0, 20.0, 70.0, 123.0], [-8.0, 5.0, 31.0, 55.0, 350.0], [0.0] * 5]


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Start the file that takes longest first: processes share files, and none waits for it."""
    items.sort(key=lambda item: item.path.name != "test_smoke.py")


@pytest.fixture
def pose_coder() -> "RegressionCoder":
    """Regression over the ranges of params.yaml."""
    from shaftpose.network.ssd.pose_coding import RegressionCoder  # torch is slow to import

    return RegressionCoder(low=(-20, -20, 10, 50, 0), high=(20, 20, 40, 90, 358))


@pytest.fixture
def bin_coder() -> "BinCoder":
    """The bins of conf/variant/b.yaml over the ranges of params.yaml."""
    from shaftpose.network.ssd.pose_bins import BinCoder

    return BinCoder((-20, -20, 10, 50, 0), (20, 20, 40, 90, 358), steps=(1, 1, 1, 5, 5))


@pytest.fixture
def tiny_network(pose_coder: "RegressionCoder") -> "SingleShotNetwork":
    """Architecture D with reproducible weights."""
    from tests.network.tiny import tiny_d

    return tiny_d(pose_coder)


@pytest.fixture(scope="session")
def database(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An MLflow database without runs; creating one takes seconds, copying is instant."""
    from mlflow import MlflowClient  # slow to import; most tests do not need it

    path = tmp_path_factory.mktemp("database") / "mlflow.db"
    MlflowClient(f"sqlite:///{path}").search_experiments()
    return path


@pytest.fixture
def store(tmp_path: Path, database: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A working directory that holds only its own MLflow database."""
    import mlflow

    from shaftpose.tracking.connection import connect

    shutil.copy(database, tmp_path / "mlflow.db")
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("MLFLOW_TRACKING_URI", raising=False)
    previous = mlflow.get_tracking_uri()
    connect(None, "trials")
    yield tmp_path
    mlflow.set_tracking_uri(previous)


@pytest.fixture
def constant_model(tmp_path: Path) -> Path:
    """A model with the interface of an exported one that finds two shafts in every image, with
    scores 0.75 and 0.25, and leaves a third place empty."""
    values = {"boxes": np.array(BOXES), "scores": np.array(SCORES), "poses": np.array(POSES)}
    return write_constant_model(tmp_path / "constant.onnx", values)


def write_constant_model(path: Path, values: dict[str, np.ndarray]) -> Path:
    """Write a model with these outputs for every image."""
    onnx.save(_constant("image", TensorProto.UINT8, (SIDE, SIDE, 3), values), str(path))
    return path


def write_mask_reader(path: Path, values: dict[str, np.ndarray]) -> Path:
    """Write a model with these outputs for every image, and the image's brightness as its mask."""
    model = _constant("image", TensorProto.UINT8, (SIDE, SIDE, 3), values)
    model.graph.initializer.append(numpy_helper.from_array(np.array(255, np.float32), "full"))
    model.graph.initializer.append(numpy_helper.from_array(np.array([3]), "axis"))
    model.graph.node.extend(
        [
            helper.make_node("Cast", ["image"], ["levels"], to=TensorProto.FLOAT),
            helper.make_node("ReduceMax", ["levels", "axis"], ["brightest"], keepdims=0),
            helper.make_node("Div", ["brightest", "full"], ["mask"]),
        ]
    )
    mask = helper.make_tensor_value_info("mask", TensorProto.FLOAT, ["N", SIDE, SIDE])
    model.graph.output.append(mask)
    onnx.checker.check_model(model)
    onnx.save(model, str(path))
    return path


def constant_edge_reader(offset: float, log_error: float) -> bytes:
    """An edge reader that says the same of every row of a strip."""
    values = {"offsets": np.full(ROWS, offset), "log_scales": np.full(ROWS, log_error)}
    model = _constant("strips", TensorProto.FLOAT, (3, ROWS, COLUMNS), values)
    return bytes(model.SerializeToString())


def _constant(
    name: str, kind: int, shape: tuple[int, ...], values: dict[str, np.ndarray]
) -> onnx.ModelProto:
    """A model with these outputs for each of the N inputs of this shape."""
    weights = []
    nodes = [helper.make_node("Shape", [name], ["batch"], start=0, end=1)]
    outputs = []
    for output, value in values.items():
        weights.append(numpy_helper.from_array(value[None].astype(np.float32), f"{output} of one"))
        weights.append(numpy_helper.from_array(np.array(value.shape), f"shape of {output}"))
        parts = ["batch", f"shape of {output}"]
        nodes.append(helper.make_node("Concat", parts, [f"{output} shape"], axis=0))
        nodes.append(helper.make_node("Expand", [f"{output} of one", f"{output} shape"], [output]))
        of_all = ["N", *value.shape]
        outputs.append(helper.make_tensor_value_info(output, TensorProto.FLOAT, of_all))
    given = helper.make_tensor_value_info(name, kind, ["N", *shape])
    graph = helper.make_graph(nodes, "constant", [given], outputs, weights)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 20)], ir_version=10)
    onnx.checker.check_model(model)
    return model
