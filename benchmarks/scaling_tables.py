"""Fills the tables of docs/scaling.md from what `make bench-render` measured.

`python -m benchmarks.scaling_tables` reads benchmarks/results/render.json.
"""

import sys
from dataclasses import dataclass
from pathlib import Path

from benchmarks.rendering.aims import AIMS
from shaftpose.config import Positive, PositiveInt, from_json
from shaftpose.errors import InputError
from shaftpose.evaluation.report import pipe_table

ROOT = Path(__file__).parents[1]
RESULTS = ROOT / "benchmarks/results/render.json"
PAGE = ROOT / "docs/scaling.md"
IMAGES = {"100 thousand": 10**5, "10 million": 10**7, "1 billion": 10**9}
CORES = (1, 16, 1000)
# A unit is used from 2 of it on.
DURATIONS = {"years": 365 * 86400, "days": 86400, "hours": 3600, "minutes": 60, "seconds": 1}
SIZES = {"PB": 10**15, "TB": 10**12, "GB": 10**9, "MB": 10**6, "kB": 10**3, "bytes": 1}


@dataclass(frozen=True)
class Settings:
    """Of the default quality."""

    samples: PositiveInt


@dataclass(frozen=True)
class Point:
    """What a number of samples gives: PSNR, and the seconds that an image takes on one core."""

    samples: PositiveInt
    psnr_db: float
    seconds: Positive


@dataclass(frozen=True)
class Quality:
    """Points by ascending samples."""

    curve: list[Point]


@dataclass(frozen=True)
class Profile:
    """Milliseconds of each step of an image."""

    milliseconds: dict[str, float]


@dataclass(frozen=True)
class Plain:
    """Seconds of a plain script for one image, on all cores of the machine."""

    plain_s: Positive


@dataclass(frozen=True)
class Parts:
    """What the parts of the benchmark found."""

    quality: Quality
    profile: Profile
    plain: Plain


@dataclass(frozen=True)
class Measured:
    """What a benchmark of the renderer found; other keys of its file are not read.

    images_per_s: of all `workers` together, a core each; bytes_per_image: on disk.
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
        """Seconds of one core for one image of the default quality."""
        return self.workers / self.images_per_s


def main() -> None:
    """Write the tables between their marks in docs/scaling.md."""
    try:
        PAGE.write_text(with_tables(PAGE.read_text(), read_measured()))
    except InputError as error:
        sys.exit(f"error: {error}")


def read_measured() -> Measured:
    """What the benchmark wrote. Raises InputError if it cannot be read."""
    try:
        return from_json(Measured, RESULTS)
    except InputError as error:
        raise InputError(f"{error}; `make bench-render` writes it") from error


def with_tables(page: str, measured: Measured) -> str:
    """A page with what was measured in the place of the tables that were there."""
    tables = {
        "aims": aims_table(measured),
        "profile": profile_table(measured),
        "quality": quality_table(measured),
        "cost": cost_table(measured),
    }
    for name, text in tables.items():
        page = filled(page, name, text)
    return page


def filled(page: str, name: str, text: str) -> str:
    """A page with `text` between the marks of `name`, instead of what was there."""
    begin, end = f"<!-- {name}: begin -->", f"<!-- {name}: end -->"
    before, found, rest = page.partition(begin)
    _, closed, after = rest.partition(end)
    if not found or not closed:
        raise InputError(f"{PAGE}: lacks {begin} or {end}; put them around the place of the table")
    return f"{before}{begin}\n{text}\n{end}{after}"


def aims_table(measured: Measured) -> str:
    """What is wanted beside what was measured."""
    values = {key: getattr(measured, key) for key in AIMS}
    rows = [
        [f"`{key}`: {aim.title}", str(aim), f"{values[key]:.4g}", aim.verdict(values[key])]
        for key, aim in AIMS.items()
    ]
    heading = f"At {measured.settings.samples} samples per pixel, the default:"
    return f"{heading}\n\n{pipe_table(['what', 'aim', 'measured', ''], rows)}"


def profile_table(measured: Measured) -> str:
    """Where the time of one image goes, the longest step first."""
    spent = measured.parts.profile.milliseconds
    total = sum(spent.values())
    rows = [
        [step, f"{value:.1f}", f"{value / total:.0%}"]
        for step, value in sorted(spent.items(), key=lambda item: -item[1])
    ]
    return pipe_table(["step of one image", "ms on one core", "share"], rows)


def quality_table(measured: Measured) -> str:
    """What more samples give and take."""
    rows = [
        [str(point.samples), f"{point.psnr_db:.1f}", f"{point.seconds:.3f}",
         rounded(10**5 * point.seconds / 16, DURATIONS)]
        for point in measured.parts.quality.curve
    ]  # fmt: skip
    columns = ["samples", "PSNR, dB", "s per image on one core", "100 thousand on 16 cores"]
    return f"{pipe_table(columns, rows)}\n\n{_price_of_the_aim(measured)}"


def _price_of_the_aim(measured: Measured) -> str:
    """How fast images are at the fewest samples that reach the wanted PSNR."""
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
    """The cost of one image, and of as many as one may want."""
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
    """One line: storage and time for so many images."""
    seconds = [images * measured.core_seconds / cores for cores in CORES]
    cells = [rounded(images * measured.bytes_per_image, SIZES)]
    return [name, *cells, *(rounded(value, DURATIONS) for value in seconds)]


def rounded(value: float, units: dict[str, int]) -> str:
    """A value at two digits or more in the largest unit of which it is two or more."""
    unit = next((unit for unit, size in units.items() if value >= 2 * size), list(units)[-1])
    count = value / units[unit]
    return f"{count:,.0f} {unit}" if count >= 10 else f"{count:.1f} {unit}"


if __name__ == "__main__":
    main()
