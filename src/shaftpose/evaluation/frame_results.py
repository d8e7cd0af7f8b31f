"""Results of a model on a part of the real frames."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from tqdm import tqdm

from shaftpose.dataset.coco_images import CocoImage
from shaftpose.evaluation.true_shafts import GROUPS, true_shafts
from shaftpose.evaluation.whole_frames import FrameModel
from shaftpose.metrics.frames.comparison import ComparedFrame, compare_frame
from shaftpose.metrics.frames.measures import FrameMetrics, frame_metrics
from shaftpose.origin import Origin

ALL = "all"


@dataclass(frozen=True)
class FrameResults:
    """A model on a part of the real frames.

    model, sha256: name and digest of its file. part, digest: of the frames and their annotations.
    threshold: the model's own, which average precision ignores. groups: `ALL` and those of
    `evaluation.true_shafts.GROUPS` with a shaft.
    """

    model: str
    sha256: str
    part: str
    digest: str
    threshold: float
    groups: Mapping[str, FrameMetrics]
    origin: Origin


def compared_frames(model: FrameModel, images: Sequence[CocoImage]) -> list[ComparedFrame]:
    """A model's detections in each image, compared with its annotations."""
    return [
        compare_frame(true_shafts(image), model(image), model.threshold)
        for image in tqdm(images, "finding shafts", unit="frame", disable=None)
    ]


def metrics_by_group(
    frames: Sequence[ComparedFrame], images: Sequence[CocoImage]
) -> dict[str, FrameMetrics]:
    """The metrics of all shafts, and of each group with a shaft."""
    operations = [image.operation for image in images]
    groups = [name for name in GROUPS if any(frame.groups[name].any() for frame in frames)]
    of_groups = {name: frame_metrics(frames, operations, name) for name in groups}
    return {ALL: frame_metrics(frames, operations), **of_groups}
