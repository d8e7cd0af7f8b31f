"""A model's detections on sets of frames, compared with the true shafts; each set once."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from tqdm import tqdm

from shaftpose.core.geometry import Camera
from shaftpose.core.images import Image
from shaftpose.core.shards import ShardedDataset
from shaftpose.inference.loading import load
from shaftpose.inference.shaft_finder import ShaftFinder
from shaftpose.refinement.contour import Shaft
from studies.whole_frames.frames import AnnotatedFrame, Reshape, as_rendered, read_frame
from studies.whole_frames.matching import Detection, TrueShaft, compared
from studies.whole_frames.rendering import FOLDER


@dataclass(frozen=True)
class Frames:
    """A set of frames: rendered squares by their name, in another shape. camera_known: whether
    their camera is stated."""

    squares: str
    reshape: Reshape = as_rendered
    camera_known: bool = True


@dataclass
class Comparison:
    """The true shafts of a set of frames that show enough to count, and all detections."""

    shafts: list[TrueShaft] = field(default_factory=list)
    detections: list[Detection] = field(default_factory=list)


class Measurement:
    """A model on frames with shafts of one kind."""

    def __init__(self, model: Path, rod: Shaft, count: int) -> None:
        self.model, self.rod, self.count = model, rod, count
        self._compared: dict[Frames, Comparison] = {}
        self._finders: dict[float | None, ShaftFinder] = {}

    def frames(self, chosen: Frames) -> Iterator[AnnotatedFrame]:
        """The frames of a set."""
        shards = ShardedDataset(FOLDER / chosen.squares)
        for number, key in enumerate(shards.keys):
            yield chosen.reshape(read_frame(shards, key), number)

    def compared(self, chosen: Frames) -> Comparison:
        """A set of frames, compared."""
        if chosen not in self._compared:
            self._compared[chosen] = self._compare(chosen)
        return self._compared[chosen]

    def _compare(self, chosen: Frames) -> Comparison:
        result = Comparison()
        for frame in tqdm(self.frames(chosen), chosen.squares, unit="frame", disable=None):
            finder = self._finder(frame.view_deg if chosen.camera_known else None)
            found_rod = self.rod._replace(diameter_mm=finder.diameter_mm or self.rod.diameter_mm)
            seen_by = camera_of(finder, frame.rgb)
            shafts, detections = compared(frame, finder(frame.rgb), seen_by, self.rod, found_rod)
            result.shafts += [shaft for shaft in shafts if shaft.counts]
            result.detections += detections
        return result

    def _finder(self, view_deg: float | None) -> ShaftFinder:
        """A finder for a camera of this angle; None: for an unknown camera and unknown shafts."""
        if view_deg not in self._finders:
            diameter_mm = None if view_deg is None else self.rod.diameter_mm
            self._finders[view_deg] = load(
                self.model, view_deg=view_deg, diameter_mm=diameter_mm, warn=lambda _: None
            )
        return self._finders[view_deg]


def camera_of(finder: ShaftFinder, rgb: Image) -> Camera:
    """The pinhole camera of a finder's poses in a frame (H, W, 3), in px of the frame."""
    height, width = rgb.shape[:2]
    matrix = finder.camera_matrix(rgb)
    return Camera(width, height, float(matrix[0, 0]), float(matrix[0, 2]), float(matrix[1, 2]))
