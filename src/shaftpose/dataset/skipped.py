"""Damaged images that a training passes over: named, and counted in the end."""

import logging
from dataclasses import dataclass
from pathlib import Path

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class SkippedImages:
    """A file with one line for each damaged image.

    The processes that load images add to it, those of all ranks and of a training that goes on.
    """

    path: Path

    def add(self, complaint: str) -> None:
        """Note and report an image, unless that was done before."""
        if complaint not in self.complaints():
            log.warning("skipped a damaged image: %s", complaint)
            with self.path.open("a") as file:
                file.write(f"{complaint}\n")

    def complaints(self) -> set[str]:
        """What was said of each image."""
        return set(self.path.read_text().splitlines()) if self.path.is_file() else set()
