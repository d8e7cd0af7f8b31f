"""Silhouettes of estimated poses, rendered by Blender (paper, IV-B)."""

import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import numpy as np
from numpy.typing import NDArray

from shaftpose.core.files import output_hidden
from shaftpose.core.geometry import Camera, ShaftPose
from shaftpose.rendering.blender import Renderer
from shaftpose.settings.schema import RenderSettings


class SilhouetteRenderer:
    """Renders masks of shafts; only one may exist per process, as Blender has one open file."""

    def __init__(self, settings: RenderSettings) -> None:
        with blender_output_hidden():
            self._renderer = Renderer(settings)

    def __call__(self, poses: NDArray[np.float64], camera: Camera) -> list[NDArray[np.bool_]]:
        """The visible mask (H, W) in `camera` for each of the poses (N, 5); nearer shafts hide
        farther ones. The roll is 0 for instruments without rotational symmetry."""
        shafts: Sequence[ShaftPose] = [ShaftPose.from_array(pose) for pose in poses]
        with blender_output_hidden():
            index = self._renderer.silhouettes(shafts, camera)
        return [index == number + 1 for number in range(len(shafts))]


@contextmanager
def blender_output_hidden() -> Iterator[None]:
    """Silence Blender, which writes its progress to standard output."""
    sys.stdout.flush()
    with output_hidden(1):
        yield
