"""Speed, quality and memory of rendering: `make bench-render`, on an idle machine.

Prints a table and writes `reports/benchmarks/render.json`. A quick run of single parts writes
nothing: `python -m benchmarks.render --quick throughput profile`.
"""

import argparse
import os
from collections.abc import Callable
from dataclasses import asdict, dataclass
from importlib.metadata import version
from typing import Any

from benchmarks.machine import RESULTS, machine
from benchmarks.rendering import memory, plain, profile, quality, throughput
from benchmarks.rendering.aims import AIMS
from benchmarks.rendering.common import PROFILE, SAMPLES, default_set
from shaftpose.core.errors import exit_on_input_error
from shaftpose.core.files import write_json
from shaftpose.rendering.rendered_set import RenderedSet

OUT = RESULTS / "render.json"


@dataclass(frozen=True)
class Counts:
    """Size of each measurement."""

    images: int = 1000
    poses: int = 50
    reference_samples: int = 1024
    sample_counts: tuple[int, ...] = (1, 2, 4, 8, 16, 24, 32, 64)
    plain_poses: int = 10
    plain_rounds: int = 10
    memory_images: int = 3000
    settled_images: int = 300
    profile_images: int = 100


FULL = Counts()
QUICK = Counts(
    images=40, poses=3, reference_samples=32, sample_counts=(1, 4), plain_poses=2, plain_rounds=2,
    memory_images=100, settled_images=50, profile_images=5,
)  # fmt: skip

Part = Callable[[RenderedSet, Counts], dict[str, Any]]
PARTS: dict[str, Part] = {
    "throughput": lambda images, n: throughput.measure(images, n.images),
    "plain": lambda images, n: plain.measure(images, n.plain_poses, n.plain_rounds),
    "profile": lambda images, n: profile.measure(images, n.profile_images),
    "memory": lambda images, n: memory.measure(images, n.memory_images, n.settled_images),
    "quality": lambda images, n: quality.measure(
        images, n.poses, n.reference_samples, n.sample_counts
    ),
}


def main() -> None:
    """Measure the selected parts in turn; a full run of all parts writes a results file."""
    arguments = _arguments()
    counts = QUICK if arguments.quick else FULL
    os.environ["OMP_NUM_THREADS"] = "1"
    with exit_on_input_error():
        rendered = default_set()
        found = {name: PARTS[name](rendered, counts) for name in PARTS if name in arguments.parts}
    print("\n".join(table(found)))
    if counts == FULL and found.keys() == PARTS.keys():
        write_json(OUT, _result(rendered, counts, found))
        print(f"written to {OUT}")


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("parts", nargs="*", default=list(PARTS), metavar="PART",
                        help=f"what to measure, all by default: {', '.join(PARTS)}")  # fmt: skip
    parser.add_argument("--quick", action="store_true", help="few images, as a smoke test")
    arguments = parser.parse_args()
    unknown = set(arguments.parts) - PARTS.keys()
    if unknown:
        parser.error(f"{', '.join(sorted(unknown))}: unknown; choose from {', '.join(PARTS)}")
    return arguments


def _result(rendered: RenderedSet, counts: Counts, found: dict[str, Any]) -> dict[str, Any]:
    """The results with machine, settings and counts."""
    values = _values(found)
    return {
        **{key: round(values[key], 4) for key in AIMS},
        "bytes_per_image": round(values["bytes_per_image"]),
        "workers": throughput.WORKERS,
        "machine": {**machine(), "bpy": version("bpy")},
        "settings": {
            "profile": PROFILE,
            "seed": rendered.seed,
            "backgrounds": len(rendered.backgrounds),
            "samples": SAMPLES,
            "jpeg_quality": rendered.settings.jpeg_quality,
        },
        "counts": asdict(counts),
        "parts": found,
    }


def _values(found: dict[str, Any]) -> dict[str, Any]:
    """The values of all parts by name."""
    return {key: value for part in found.values() for key, value in part.items()}


def table(found: dict[str, Any]) -> list[str]:
    """Lines of targets and measurements, the profile and the cost of quality."""
    values = _values(found)
    lines = [f"{'':42}{'measured':>10}{'aim':>10}"]
    for key, aim in AIMS.items():
        if key in values:
            value = values[key]
            lines.append(f"{aim.title:42}{value:10.4g}{aim!s:>10}  {aim.verdict(value)}")
    if "throughput" in found:
        lines += _throughput_lines(found["throughput"])
    if "plain" in found:
        lines += _plain_lines(found["plain"])
    if "profile" in found:
        lines += _profile_lines(found["profile"])
    if "quality" in found:
        lines += _quality_lines(found["quality"])
    return lines


def _throughput_lines(part: dict[str, Any]) -> list[str]:
    rates = part["steady_images_per_s"]
    return [
        "",
        f"start {part['start_s']:.1f} s; after it "
        + ", ".join(f"{rate:.2f} images/s with {n} worker(s)" for n, rate in rates.items()),
        f"{part['bytes_per_image']:.0f} bytes per image",
    ]


def _plain_lines(part: dict[str, Any]) -> list[str]:
    return [
        "",
        f"{part['plain_s']:.3g} s per image of a plain script, {part['ours_s']:.3g} s of ours",
    ]


def _profile_lines(part: dict[str, Any]) -> list[str]:
    spent, total = part["milliseconds"], part["total_milliseconds"]
    ordered = sorted(spent.items(), key=lambda item: -item[1])
    lines = [f"{step:32}{value:8.1f}{value / total:8.0%}" for step, value in ordered]
    return ["", f"{'one image on one core':32}{'ms':>8}", *lines, f"{'all':32}{total:8.1f}"]


def _quality_lines(part: dict[str, Any]) -> list[str]:
    row = "{samples:10}{psnr_db:14.1f}{psnr_db_least:12.1f}{seconds:14.3f}"
    lines = [row.format(**point) for point in part["curve"]]
    heading = f"{'samples':>10}{'PSNR dB':>14}{'least':>12}{'s per image':>14}"
    return ["", heading, *lines, _price_of_the_aim(part["curve"])]


def _price_of_the_aim(curve: list[dict[str, Any]]) -> str:
    """Speed at the fewest samples that reach the target PSNR."""
    wanted = AIMS["psnr_db"]
    enough = next((point for point in curve if wanted.is_met(point["psnr_db"])), None)
    if enough is None:
        return f"{wanted.least:g} dB are not reached"
    samples, rate = enough["samples"], 1 / enough["seconds"]
    return f"{wanted.least:g} dB take {samples} samples: {rate:.2g} images/s on one core"


if __name__ == "__main__":
    main()
