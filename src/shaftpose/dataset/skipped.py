"""Record of the damaged images that a training skips."""

import logging
from dataclasses import dataclass
from pathlib import Path

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class SkippedImages:
    """A file with one line for each damaged image.

    The loader processes of all ranks add to it, and so does a resumed training.
    """

    path: Path

    def add(self, complaint: str) -> None:
        """Record and log an image, unless it is already recorded."""
        if complaint not in self.complaints():
            log.warning("skipped a damaged image: %s", complaint)
            with self.path.open("a") as file:
                file.write(f"{complaint}\n")

    def complaints(self) -> set[str]:
        """The recorded lines."""
        return set(self.path.read_text().splitlines()) if self.path.is_file() else set()
