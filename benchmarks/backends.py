"""The default model and the paper's whole network D in PyTorch, onnxruntime and OpenVINO, in 32, 16
and 8 bits: `make bench-inference`, on an idle machine.

Writes `reports/benchmarks/backends.json`. Weights of the paper's network are random, which does not
affect speed.
"""

import statistics
from importlib.metadata import version
from itertools import cycle
from pathlib import Path
from tempfile import TemporaryDirectory

import cv2
import numpy as np
import torch

from benchmarks.inference import FILM, ROOT, Run, times
from benchmarks.machine import RESULTS, machine
from shaftpose.core.files import write_json
from shaftpose.core.images import Image
from shaftpose.export.compression import quantise
from shaftpose.export.onnx_export import ShaftDetector, export_onnx
from shaftpose.frame_sources.video_files import VideoFile
from shaftpose.inference.backends import open_network, openvino_core
from shaftpose.inference.model_files import DEFAULT, bundled_model
from shaftpose.network.building import build_network
from shaftpose.settings.choices import Backend
from shaftpose.settings.compose import composed_settings
from shaftpose.training.recipe import training_recipe

OUT = RESULTS / "backends.json"
ROUNDS, PER_ROUND = 20, 5
PROFILE = "paper"
SIDE_PX = 299


def main() -> None:
    """Measure and write."""
    frames = [cv2.resize(frame.rgb, (SIDE_PX, SIDE_PX)) for frame in VideoFile(FILM).frames()]
    images = np.stack(frames).astype(np.uint8)
    recipe = training_recipe(composed_settings(ROOT, "variant=d", f"profile={PROFILE}"))
    rows, detector = [], ShaftDetector(build_network(recipe.variant), recipe.detection).eval()
    title = f"D, width {recipe.size.width:g}, depth {recipe.size.depth:g}"
    with TemporaryDirectory() as folder:
        path = Path(folder) / "paper.onnx"
        export_onnx(detector, path, SIDE_PX)
        networks = {
            "default": ways(bundled_model(DEFAULT), images),
            title: {"PyTorch, 32 bits": in_pytorch(detector)} | ways(path, images),
        }
        for network, those in networks.items():
            for name, seconds in times(those, cycle(images), ROUNDS, PER_ROUND).items():
                fps = round(1 / statistics.median(seconds), 1)
                p95 = round(1000 * float(np.percentile(seconds, 95)), 1)
                rows.append({"network": network, "run by": name, "fps_median": fps, "ms_p95": p95})
                print(rows[-1])
    packages = {name: version(name) for name in ("torch", "onnxruntime", "openvino")}
    result = {"machine": machine(), **packages, "frames": ROUNDS * PER_ROUND, "backends": rows}
    write_json(OUT, result)
    print(f"written to {OUT}")


def ways(floats: Path, images: Image) -> dict[str, Run]:
    """The ways to run an ONNX file, with ranges of its 8-bit form from images (N, S, S, 3)."""
    with TemporaryDirectory() as folder:
        integers = Path(folder) / "int8.onnx"
        quantise(floats, integers, images[::5])
        return {
            "onnxruntime, 32 bits": by(floats, "onnxruntime"),
            "onnxruntime, 8 bits": by(integers, "onnxruntime"),
            "OpenVINO, 32 bits": by(floats, "openvino"),
            "OpenVINO, 16 bits": in_16_bits(floats),
            "OpenVINO, 8 bits": by(integers, "openvino"),
        }


def by(path: Path, backend: Backend) -> Run:
    """As the package runs models."""
    network = open_network(path, backend)
    return lambda image: network.run(network.outputs, image[None])


def in_16_bits(path: Path) -> Run:
    """By OpenVINO in bfloat16, which the package does not offer."""
    settings = {"INFERENCE_PRECISION_HINT": "bf16", "PERFORMANCE_HINT": "LATENCY"}
    model = openvino_core().compile_model(str(path), "CPU", settings)
    return lambda image: model(image[None])


def in_pytorch(detector: ShaftDetector) -> Run:
    """As it is trained, operation by operation."""

    def run(image: Image) -> object:
        with torch.inference_mode():
            return detector(torch.from_numpy(image[None]))

    return run


if __name__ == "__main__":
    main()
