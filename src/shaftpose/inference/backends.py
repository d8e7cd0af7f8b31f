"""The programs that run an exported model: onnxruntime and, where it is installed, OpenVINO."""

import os
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from threading import Lock
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from shaftpose.core.errors import InputError
from shaftpose.inference.sessions import check_model, open_session
from shaftpose.settings.choices import Backend

_THREADS = "ORT_INTRA_OP_NUM_THREADS"


class Network(Protocol):
    """An opened model for images (N, H, W, 3) uint8 RGB.

    side_px: the side of its square images; None if it takes images of any height and width.
    """

    outputs: list[str]
    metadata: Mapping[str, str]
    side_px: int | None

    def run(self, outputs: Sequence[str], images: NDArray[np.uint8]) -> list[NDArray[np.float32]]:
        """Run the model; returns the values of these outputs."""


def open_network(path: Path, backend: Backend) -> Network:
    """Open a model file.

    Raises InputError if the backend is not installed, if the file cannot be read or may run for
    ever, or if the environment variable for the number of threads is not a number.
    """
    threads = _most_threads()
    try:
        return _InOpenVino(path, threads) if backend == "openvino" else _InOnnxruntime(path)
    except ImportError as error:
        raise InputError(
            f"--backend openvino: needs OpenVINO: in a clone, pip install '.[openvino]' ({error})"
        ) from error
    except Exception as error:  # the backends' own exceptions have no common base
        cause = " ".join(str(error).split())
        raise InputError(f"{path}: not a readable ONNX model; export it again: {cause}") from error


def _most_threads() -> int:
    """onnxruntime's environment variable, which also limits OpenVINO; 0: no limit."""
    stated = os.environ.get(_THREADS) or "0"
    if not stated.isdecimal():
        raise InputError(f"{_THREADS}={stated}: not a number of threads; set one, or unset it")
    return int(stated)


class _InOnnxruntime:
    def __init__(self, path: Path) -> None:
        self._session = open_session(path.read_bytes())
        self.outputs = [output.name for output in self._session.get_outputs()]
        self.metadata: Mapping[str, str] = self._session.get_modelmeta().custom_metadata_map
        height = self._session.get_inputs()[0].shape[1]
        self.side_px = height if isinstance(height, int) else None

    def run(self, outputs: Sequence[str], images: NDArray[np.uint8]) -> list[NDArray[np.float32]]:
        return list(self._session.run(outputs, {"image": images}))


@cache
def openvino_core() -> Any:
    """OpenVINO's plug-ins, created once per process: creating them repeatedly crashes it later.

    Raises ImportError if OpenVINO is not installed.
    """
    import openvino

    return openvino.Core()


class _InOpenVino:
    def __init__(self, path: Path, threads: int) -> None:
        from openvino.frontend import FrontEndManager

        check_model(path.read_bytes())
        # Core.read_model would try formats other than ONNX, too.
        reader = FrontEndManager().load_by_framework("onnx")
        model: Any = reader.convert(reader.load(str(path)))
        stated = model.get_rt_info()["framework"] if model.has_rt_info("framework") else {}
        self.metadata: Mapping[str, str] = {
            name: str(value.value) for name, value in stated.items()
        }
        self.outputs = [output.get_any_name() for output in model.outputs]
        settings: dict[str, str | int] = {
            # The default, 16 bits on processors that have them, changes poses.
            "INFERENCE_PRECISION_HINT": "f32",
            "PERFORMANCE_HINT": "LATENCY",
            "INFERENCE_NUM_THREADS": threads,
        }
        height = model.inputs[0].partial_shape[1]
        self.side_px = int(height.get_length()) if height.is_static else None
        self._busy = Lock()  # one request at a time
        self._compiled = openvino_core().compile_model(model, "CPU", settings)

    def run(self, outputs: Sequence[str], images: NDArray[np.uint8]) -> list[NDArray[np.float32]]:
        with self._busy:
            values = self._compiled(images)  # copies
        return [np.asarray(values[name]) for name in outputs]
