"""Fills the table of docs/scaling.md from the speed that `make bench-render` measured.

`python benchmarks/scaling_table.py` reads benchmarks/results/render.json: `images_per_s` of all
`workers` together, a core each, and `bytes_per_image` on disk.
"""

import sys
from dataclasses import dataclass
from pathlib import Path

from shaftpose.config import Positive, PositiveInt, from_json
from shaftpose.errors import InputError

ROOT = Path(__file__).parents[1]
RESULTS = ROOT / "benchmarks/results/render.json"
PAGE = ROOT / "docs/scaling.md"
BEGIN, END = "<!-- table: begin -->", "<!-- table: end -->"
IMAGES = {"100 thousand": 10**5, "10 million": 10**7, "1 billion": 10**9}
CORES = (1, 16, 1000)
# A unit is used from 2 of it on.
DURATIONS = {"years": 365 * 86400, "days": 86400, "hours": 3600, "minutes": 60, "seconds": 1}
SIZES = {"PB": 10**15, "TB": 10**12, "GB": 10**9, "MB": 10**6, "kB": 10**3, "bytes": 1}


@dataclass(frozen=True)
class Measured:
    """What a benchmark of the renderer found; other keys of its file are not read."""

    images_per_s: Positive
    bytes_per_image: Positive
    workers: PositiveInt

    @property
    def core_seconds(self) -> float:
        """Seconds of one core for one image."""
        return self.workers / self.images_per_s


def main() -> None:
    """Write the table between its marks in docs/scaling.md."""
    try:
        measured = from_json(Measured, RESULTS)
    except InputError as error:
        sys.exit(f"error: {error}; `make bench-render` writes it")
    PAGE.write_text(filled(PAGE.read_text(), table(measured)))


def filled(page: str, text: str) -> str:
    """A page with `text` between the marks, instead of what was there."""
    before, begin, rest = page.partition(BEGIN)
    _, end, after = rest.partition(END)
    if not begin or not end:
        raise InputError(f"{PAGE}: lacks {BEGIN} or {END}; put them around the place of the table")
    return f"{before}{BEGIN}\n{text}\n{END}{after}"


def table(measured: Measured) -> str:
    """The cost of one image, and of as many as one may want, as Markdown."""
    cores = [f"{count:,} core{'s' if count > 1 else ''}" for count in CORES]
    return "\n".join(
        [
            f"Measured: {measured.images_per_s:.3g} images/s with {measured.workers} workers, a "
            f"core each: {measured.core_seconds:.3g} core-seconds and",
            f"{rounded(measured.bytes_per_image, SIZES)} per image.",
            "",
            f"| images | storage | {' | '.join(cores)} |",
            "|---" * (2 + len(CORES)) + "|",
            *(row(name, images, measured) for name, images in IMAGES.items()),
        ]
    )


def row(name: str, images: int, measured: Measured) -> str:
    """One line: storage and time for so many images."""
    seconds = [images * measured.core_seconds / cores for cores in CORES]
    cells = [rounded(images * measured.bytes_per_image, SIZES)]
    cells += [rounded(value, DURATIONS) for value in seconds]
    return f"| {name} | {' | '.join(cells)} |"


def rounded(value: float, units: dict[str, int]) -> str:
    """A value at two digits or more in the largest unit of which it is two or more."""
    unit = next((unit for unit, size in units.items() if value >= 2 * size), list(units)[-1])
    count = value / units[unit]
    return f"{count:,.0f} {unit}" if count >= 10 else f"{count:.1f} {unit}"


if __name__ == "__main__":
    main()
