"""The network of the default model by onnxruntime and OpenVINO, in 32 and in 8 bits:
`make bench-inference`, on an idle machine.

Writes `benchmarks/results/backends.json`. OpenVINO is measured where it is installed.
"""

import statistics
import time
from collections.abc import Callable, Iterator, Mapping
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory

import cv2
import numpy as np
import onnxruntime
from numpy.typing import NDArray
from onnxruntime.quantization import CalibrationDataReader, QuantFormat, quantize_static
from onnxruntime.quantization.shape_inference import quant_pre_process

from benchmarks.inference import FILM, PAUSE_S, ROOT
from benchmarks.machine import machine
from shaftpose.core.images import Image
from shaftpose.deployment.bundled import DEFAULT, bundled_model
from shaftpose.inference.video_files import VideoFile
from shaftpose.json_files import write_json

OUT = ROOT / "benchmarks/results/backends.json"
ROUNDS, PER_ROUND = 20, 5
SIDE_PX = 299
Run = Callable[[Image], object]


class Calibration(CalibrationDataReader):
    """Gives the quantizer one image after the other."""

    def __init__(self, images: Image) -> None:
        self._images: Iterator[Image] = iter(images)

    def get_next(self) -> dict[str, Image] | None:
        """The next image, as the network's input."""
        image = next(self._images, None)
        return None if image is None else {"image": image[None]}


def main() -> None:
    """Measure and write."""
    frames = [cv2.resize(frame.rgb, (SIDE_PX, SIDE_PX)) for frame in VideoFile(FILM).frames()]
    images = np.stack(frames).astype(np.uint8)
    with TemporaryDirectory() as folder:
        floats, integers = bundled_model(DEFAULT), Path(folder) / "int8.onnx"
        quantise(floats, integers, images[::5])
        ways: dict[str, Run] = {}
        for bits, path in ((32, floats), (8, integers)):
            ways[f"onnxruntime, {bits} bits"] = in_onnxruntime(path)
            if find_spec("openvino"):
                ways[f"openvino, {bits} bits"] = in_openvino(path)
        speeds = measure(ways, images)
    rows = [{"network": name, "fps_median": round(speed, 1)} for name, speed in speeds.items()]
    names = ("onnxruntime", *(["openvino"] if find_spec("openvino") else []))
    packages = {name: version(name) for name in names}
    write_json(OUT, {"machine": machine(), **packages, "backends": rows})
    for row in rows:
        print(row)
    print(f"written to {OUT.relative_to(ROOT)}")


def quantise(model: Path, out: Path, images: Image) -> None:
    """Write a model whose convolutions compute in 8 bits, with ranges from images (N, S, S, 3)."""
    prepared = out.with_name("prepared.onnx")
    quant_pre_process(str(model), str(prepared), skip_symbolic_shape=True)
    quantize_static(
        str(prepared), str(out), Calibration(images), quant_format=QuantFormat.QDQ,
        op_types_to_quantize=["Conv"], per_channel=True,
    )  # fmt: skip


def in_onnxruntime(path: Path) -> Run:
    """As the package runs models."""
    session = onnxruntime.InferenceSession(str(path), providers=["CPUExecutionProvider"])
    return lambda image: session.run(None, {"image": image[None]})


def in_openvino(path: Path) -> Run:
    """In 32 bits where the model is in 32 bits: OpenVINO's default may be 16."""
    import openvino

    settings = {"INFERENCE_PRECISION_HINT": "f32", "PERFORMANCE_HINT": "LATENCY"}
    model = openvino.Core().compile_model(str(path), "CPU", settings)
    return lambda image: model(image[None])


def measure(ways: Mapping[str, Run], images: NDArray[np.uint8]) -> dict[str, float]:
    """Median images/s of each, one image at a time; each round runs all of them."""
    seconds: dict[str, list[float]] = {name: [] for name in ways}
    for number in range(ROUNDS + 1):
        for name, run in ways.items():
            time.sleep(PAUSE_S)
            for image in images[:PER_ROUND]:
                start = time.perf_counter()
                run(image)
                if number:  # the first round warms up
                    seconds[name].append(time.perf_counter() - start)
    return {name: 1 / statistics.median(taken) for name, taken in seconds.items()}


if __name__ == "__main__":
    main()
