"""Fills the tables of docs/scaling.md with the results of `make bench-render`.

`python -m studies.scaling_tables` reads benchmarks/results/render.json.
"""

from dataclasses import dataclass
from pathlib import Path

from benchmarks.rendering.aims import AIMS
from shaftpose.core.errors import exit_on_input_error
from shaftpose.figures.markdown import pipe_table
from shaftpose.settings.schema import Positive, PositiveInt
from shaftpose.stage_files import read_stage_file
from studies.pages import rewrite, with_tables

ROOT = Path(__file__).parents[1]
RESULTS = ROOT / "benchmarks/results/render.json"
PAGE = ROOT / "docs/scaling.md"
IMAGES = {"100 thousand": 10**5, "10 million": 10**7, "1 billion": 10**9}
CORES = (1, 16, 1000)
# A unit is used from a value of 2.
DURATIONS = {"years": 365 * 86400, "days": 86400, "hours": 3600, "minutes": 60, "seconds": 1}
SIZES = {"PB": 10**15, "TB": 10**12, "GB": 10**9, "MB": 10**6, "kB": 10**3, "bytes": 1}


@dataclass(frozen=True)
class Settings:
    """The quality of the measured images."""

    samples: PositiveInt


@dataclass(frozen=True)
class Point:
    """PSNR, and seconds per image on one core, at a number of samples."""

    samples: PositiveInt
    psnr_db: float
    seconds: Positive


@dataclass(frozen=True)
class Quality:
    """Points by ascending samples."""

    curve: list[Point]


@dataclass(frozen=True)
class Profile:
    """Milliseconds of each step per image."""

    milliseconds: dict[str, float]


@dataclass(frozen=True)
class Plain:
    """Seconds per image of a plain script, on all cores of the machine."""

    plain_s: Positive


@dataclass(frozen=True)
class Parts:
    """Results of the parts of the benchmark."""

    quality: Quality
    profile: Profile
    plain: Plain


@dataclass(frozen=True)
class Measured:
    """Results of the renderer's benchmark; other keys of its file are ignored.

    images_per_s: of all `workers` together, one core each; bytes_per_image: on disk.
    """

    images_per_s: Positive
    psnr_db: float
    speedup_vs_plain: Positive
    two_worker_speedup: Positive
    rss_growth: float
    rss_mib: Positive
    bytes_per_image: Positive
    workers: PositiveInt
    settings: Settings
    parts: Parts

    @property
    def core_seconds(self) -> float:
        """Core-seconds per image at the default quality."""
        return self.workers / self.images_per_s


def main() -> None:
    """Write the tables between their markers in docs/scaling.md."""
    with exit_on_input_error():
        rewrite(PAGE, lambda text: page(text, read_measured()))


def read_measured() -> Measured:
    """The benchmark's results. Raises InputError if the file cannot be read."""
    return read_stage_file(RESULTS, Measured, "run `make bench-render`")


def page(text: str, measured: Measured) -> str:
    """The page with its tables up to date."""
    tables = {
        "aims": aims_table(measured),
        "profile": profile_table(measured),
        "quality": quality_table(measured),
        "cost": cost_table(measured),
    }
    return with_tables(text, tables, "make results", "docs/scaling.md")


def aims_table(measured: Measured) -> str:
    """Table of targets and measurements."""
    values = {key: getattr(measured, key) for key in AIMS}
    rows = [
        [f"`{key}`: {aim.title}", str(aim), f"{values[key]:.4g}", aim.verdict(values[key])]
        for key, aim in AIMS.items()
    ]
    heading = f"At {measured.settings.samples} samples per pixel:"
    return f"{heading}\n\n{pipe_table(['what', 'aim', 'measured', ''], rows)}"


def profile_table(measured: Measured) -> str:
    """Table of the time per step of one image, longest first."""
    spent = measured.parts.profile.milliseconds
    total = sum(spent.values())
    rows = [
        [step, f"{value:.1f}", f"{value / total:.0%}"]
        for step, value in sorted(spent.items(), key=lambda item: -item[1])
    ]
    return pipe_table(["step of one image", "ms on one core", "share"], rows)


def quality_table(measured: Measured) -> str:
    """Table of quality and cost by number of samples."""
    rows = [
        [str(point.samples), f"{point.psnr_db:.1f}", f"{point.seconds:.3f}",
         rounded(10**5 * point.seconds / 16, DURATIONS)]
        for point in measured.parts.quality.curve
    ]  # fmt: skip
    columns = ["samples", "PSNR, dB", "s per image on one core", "100 thousand on 16 cores"]
    return f"{pipe_table(columns, rows)}\n\n{_price_of_the_aim(measured)}"


def _price_of_the_aim(measured: Measured) -> str:
    """Speed at the fewest samples that reach the target PSNR."""
    wanted = AIMS["psnr_db"]
    enough = next((p for p in measured.parts.quality.curve if wanted.is_met(p.psnr_db)), None)
    if enough is None:
        return f"{wanted.least:g} dB are not reached."
    rate = measured.two_worker_speedup / enough.seconds
    times = rate * measured.parts.plain.plain_s
    return (
        f"At the {enough.samples} samples that {wanted.least:g} dB take, two workers would render "
        f"{rate:.2g} images/s, {times:.2g} times as many as a plain script (calculated from "
        "the other measurements)."
    )


def cost_table(measured: Measured) -> str:
    """Cost of one image and table of the cost of large sets."""
    rows = [_cost_row(name, images, measured) for name, images in IMAGES.items()]
    cores = [f"{count:,} core{'s' if count > 1 else ''}" for count in CORES]
    return "\n".join(
        [
            f"At {measured.settings.samples} samples per pixel: {measured.images_per_s:.3g} "
            f"images/s with {measured.workers} workers, a core each:",
            f"{measured.core_seconds:.3g} core-seconds and "
            f"{rounded(measured.bytes_per_image, SIZES)} per image.",
            "",
            pipe_table(["images", "storage", *cores], rows),
        ]
    )


def _cost_row(name: str, images: int, measured: Measured) -> list[str]:
    """One row: storage and time for a number of images."""
    seconds = [images * measured.core_seconds / cores for cores in CORES]
    cells = [rounded(images * measured.bytes_per_image, SIZES)]
    return [name, *cells, *(rounded(value, DURATIONS) for value in seconds)]


def rounded(value: float, units: dict[str, int]) -> str:
    """A value to at least two digits, in the largest unit in which it is at least 2."""
    unit = next((unit for unit, size in units.items() if value >= 2 * size), list(units)[-1])
    count = value / units[unit]
    return f"{count:,.0f} {unit}" if count >= 10 else f"{count:.1f} {unit}"


if __name__ == "__main__":
    main()
