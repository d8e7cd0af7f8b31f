"""Sampling of shaft poses, uniform over the ranges of the paper's table.

The poses of an image are drawn again if a tip projects outside the image, if too little of a shaft
is visible, or if a shaft intersects the lens or another one. These conditions are this project's.
"""

from collections import Counter
from dataclasses import dataclass
from enum import Enum

import numpy as np

from shaftpose.core.cylinder import cylinder_depth, segment_distance
from shaftpose.core.errors import InputError
from shaftpose.core.geometry import Camera, ShaftPose
from shaftpose.core.masks import crossed_share, is_crossed
from shaftpose.settings.schema import PoseRanges, SceneSettings, ShaftSettings

MOST_TRIES = 10_000
# Visibility is checked on every fourth pixel in each direction: accurate enough for a threshold.
_STRIDE = 4
_CROSSING_TRIES = 200


class Refusal(Enum):
    """Reasons to reject poses, each with the settings in params.yaml that cause it."""

    TIP = "a tip outside the image (poses.x_mm, poses.y_mm, poses.z_mm, camera.view_deg, lens)"
    LENS = "a shaft that cuts the lens (scene.lens_radius_mm, poses.z_mm, poses.pitch_deg, shaft)"
    CUT = "shafts that cut each other (scene.instruments, shaft)"
    UNSEEN = "too few pixels in view (scene.min_visible_px, scene.instruments, shaft)"


@dataclass(frozen=True)
class SampledPoses:
    """Poses of one image and the number of shafts drawn for them (for the acceptance rate)."""

    poses: tuple[ShaftPose, ...]
    tries: int


@dataclass(frozen=True)
class PoseSampler:
    """Draws the poses of one image."""

    camera: Camera
    ranges: PoseRanges
    shaft: ShaftSettings
    scene: SceneSettings

    def __call__(self, rng: np.random.Generator, count: int) -> SampledPoses:
        """Poses of `count` shafts of one image.

        Raises InputError with the reasons after `MOST_TRIES` rejected draws.
        """
        refusals: Counter[Refusal] = Counter()
        for tries in range(1, MOST_TRIES + 1):
            poses = [self._draw(rng) for _ in range(count)]
            refusal = self._refusal(poses)
            if refusal is None:
                return SampledPoses(tuple(poses), tries * max(count, 1))
            refusals[refusal] += 1
        found = "; ".join(f"{times} for {why.value}" for why, times in refusals.most_common())
        raise InputError(
            f"params.yaml: {MOST_TRIES} draws of {count} shaft(s) were refused: {found}; "
            "change the settings named first"
        )

    def crossing(self, rng: np.random.Generator, poses: tuple[ShaftPose, ...]) -> ShaftPose | None:
        """A further shaft that crosses in front of one of `poses` and hides the required share of
        it. All poses together are acceptable. None if `_CROSSING_TRIES` draws find none."""
        behind = np.stack([self._depth(pose) for pose in poses])
        for _ in range(_CROSSING_TRIES):
            pose = self._draw(rng)
            if self._refusal([*poses, pose]) is None and self._crosses(pose, behind):
                return pose
        return None

    def _draw(self, rng: np.random.Generator) -> ShaftPose:
        return ShaftPose.from_array(rng.uniform(self.ranges.low, self.ranges.high))

    def _refusal(self, poses: list[ShaftPose]) -> Refusal | None:
        """The first reason to reject the poses of an image; None if they are acceptable."""
        if not all(map(self._tip_in_view, poses)):
            return Refusal.TIP
        if not all(map(self._clear_of_lens, poses)):
            return Refusal.LENS
        if not self._apart(poses):
            return Refusal.CUT
        return None if self._enough_visible(poses) else Refusal.UNSEEN

    def _tip_in_view(self, pose: ShaftPose) -> bool:
        return bool(self.camera.shows(self.camera.project(pose.tip_mm)))

    def _axis(self, pose: ShaftPose) -> tuple[np.ndarray, np.ndarray]:
        return pose.tip_mm, pose.tip_mm + self.shaft.length_mm * pose.direction

    def _clear_of_lens(self, pose: ShaftPose) -> bool:
        lens = np.zeros(3)
        distance = segment_distance(lens, lens, *self._axis(pose))
        return distance > self.scene.lens_radius_mm + self.shaft.diameter_mm / 2

    def _apart(self, poses: list[ShaftPose]) -> bool:
        pairs = [(a, b) for n, a in enumerate(poses) for b in poses[:n]]
        return all(
            segment_distance(*self._axis(a), *self._axis(b)) > self.shaft.diameter_mm
            for a, b in pairs
        )

    def _enough_visible(self, poses: list[ShaftPose]) -> bool:
        if not poses:
            return True
        depths = np.stack([self._depth(pose) for pose in poses])
        nearest = np.argmin(depths, axis=0)
        seen = [np.sum((nearest == n) & np.isfinite(depths[n])) for n in range(len(poses))]
        return min(seen) * _STRIDE**2 >= self.scene.min_visible_px

    def _crosses(self, pose: ShaftPose, behind: np.ndarray) -> bool:
        """Whether a shaft hides the required share of others with the depths (N, h, w)."""
        depth = self._depth(pose)
        shares = [crossed_share(depth < other, [np.isfinite(other)]) for other in behind]
        return is_crossed(max(shares), self.scene.crossing_coverage)

    def _depth(self, pose: ShaftPose) -> np.ndarray:
        size = self.shaft.diameter_mm, self.shaft.length_mm
        return cylinder_depth(self.camera, pose, *size, _STRIDE)
