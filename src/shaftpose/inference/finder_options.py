"""The options of a finder, which another process can be given."""

from dataclasses import asdict, dataclass
from pathlib import Path

from shaftpose.inference.frame_cameras import Warn
from shaftpose.inference.loading import load
from shaftpose.inference.shaft_finder import ShaftFinder
from shaftpose.settings.choices import Backend, Refinement


@dataclass(frozen=True)
class FinderOptions:
    """Arguments of `load`."""

    model: str | None
    camera: Path | None
    view_deg: float | None
    diameter_mm: float | None
    score: float | None
    refine: Refinement
    backend: Backend

    def finder(self, warn: Warn) -> ShaftFinder:
        """A finder with these options; see `load`."""
        return load(**asdict(self), warn=warn)
