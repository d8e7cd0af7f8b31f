"""Draw docs/images/architecture.png: the backbone and the heads, as the paper's Figure 4 has them.

Sizes and channels are read from the networks of conf/variant at width and depth 1.0.
"""

from dataclasses import dataclass
from typing import Any

import matplotlib
import yaml

matplotlib.use("Agg")

from architecture_tables import ROOT, build, networks, stages
from matplotlib import pyplot
from matplotlib.patches import FancyBboxPatch

from shaftpose.network.default_boxes import BOXES_PER_CELL
from shaftpose.network.heads import BOX_OFFSETS, CLASSES, ArchitectureD, ConditionedPosePath
from shaftpose.network.inception_v4 import MAP_SIZES
from shaftpose.network.pose_bins import BinCoder
from shaftpose.network.shaft_network import ShaftNetwork

PICTURE = ROOT / "docs/images/architecture.png"
# Okabe and Ito's palette, paled.
LAYER, MAP, CLASS, BOX, POSE = "#eeeeee", "#cfe3f3", "#f8e3b5", "#cdeadf", "#f3d3c2"


@dataclass(frozen=True)
class Block:
    """A labelled rectangle: its centre, width and height."""

    x: float
    y: float
    width: float
    height: float

    @property
    def top(self) -> tuple[float, float]:
        """The middle of the upper edge."""
        return self.x, self.y + self.height / 2

    @property
    def bottom(self) -> tuple[float, float]:
        """The middle of the lower edge."""
        return self.x, self.y - self.height / 2

    @property
    def left(self) -> tuple[float, float]:
        """The middle of the left edge."""
        return self.x - self.width / 2, self.y

    @property
    def right(self) -> tuple[float, float]:
        """The middle of the right edge."""
        return self.x + self.width / 2, self.y


class Sketch:
    """A page of 100 x 68 units to draw blocks and arrows on."""

    def __init__(self) -> None:
        self.figure, self.axes = pyplot.subplots(figsize=(12.5, 8.5))
        self.figure.subplots_adjust(0, 0, 1, 1)
        self.axes.set(xlim=(0, 100), ylim=(0, 68))
        self.axes.axis("off")

    def block(
        self, x: float, y: float, text: str, colour: str, width: float = 11.5, height: float = 4.4
    ) -> Block:
        """A rectangle around (x, y) with text in it."""
        corner = x - width / 2, y - height / 2
        style = "round,pad=0,rounding_size=0.5"
        self.axes.add_patch(
            FancyBboxPatch(corner, width, height, style, facecolor=colour, edgecolor="#555555")
        )
        self.text(x, y, text)
        return Block(x, y, width, height)

    def arrow(self, start: tuple[float, float], end: tuple[float, float]) -> None:
        """An arrow from point to point."""
        arrow = {"arrowstyle": "-|>", "color": "#333333", "shrinkA": 0, "shrinkB": 0}
        self.axes.annotate("", end, start, arrowprops=arrow)

    def text(self, x: float, y: float, text: str, size: float = 9.5, **how: str) -> None:
        """Text around (x, y), or as `how` says."""
        alignment: dict[str, Any] = {"ha": "center", "va": "center", **how}
        self.axes.text(x, y, text, fontsize=size, linespacing=1.25, **alignment)


def main() -> None:
    """Draw all parts and save the picture."""
    files = {names.split(", ")[0]: file for names, file in networks().items()}
    b, c, d = (build(files[name], width=1.0, depth=1.0) for name in ("b", "c", "d"))
    sketch = Sketch()
    draw_backbone(sketch, d)
    draw_classes(sketch, b, 1.5)
    draw_numbers(sketch, c, 32.5)
    draw_conditioned(sketch, d, 60.5)
    draw_decoding(sketch, d)
    sketch.figure.savefig(PICTURE, dpi=100, pil_kwargs={"optimize": True})


def draw_backbone(sketch: Sketch, network: ShaftNetwork) -> None:
    """The stages from left to right, each with the map it makes below it."""
    heading = "(a)  Backbone: Inception-v4 and three more stages, width 1.0, depth 1.0"
    title(sketch, 1.5, 66.2, heading)
    before = sketch.block(6, 60, "image\n299 x 299 x 3", MAP, width=9)
    made = zip(stages(1.0), MAP_SIZES, network.backbone.channels, BOXES_PER_CELL,
               strict=True)  # fmt: skip
    for i, (stage, size, channels, boxes) in enumerate(made):
        x = 19.3 + 14.7 * i
        layers = sketch.block(x, 60, stage.replace(", ", ",\n"), LAYER, width=13.4, height=5.2)
        sketch.arrow(before.right, layers.left)
        text = f"{size} x {size} x {channels:,}\nN = {boxes}: {size * size * boxes:,} boxes"
        feature = sketch.block(x, 51.5, text, MAP, width=13.4)
        sketch.arrow(layers.bottom, feature.top)
        before = layers


def draw_classes(sketch: Sketch, network: ShaftNetwork, left: float) -> None:
    """Architecture B: the pose as classes."""
    title(sketch, left, 44.6, "(b)  one-hot pose (SSD-6D)")
    pose = draw_side_by_side(sketch, network, left)
    assert isinstance(network.pose_coder, BinCoder)
    bins = " + ".join(str(count) for count in network.pose_coder.bins)
    text = f"softmax of each dimension:\n{bins} classes;\nthe likeliest one's centre"
    centres = sketch.block(left + 18.2, 15.5, text, POSE, width=19.8, height=6.2)
    sketch.arrow(pose.bottom, (pose.x, centres.top[1]))


def draw_numbers(sketch: Sketch, network: ShaftNetwork, left: float) -> None:
    """Architecture C: the pose as numbers."""
    title(sketch, left, 44.6, "(c)  naive regression")
    pose = draw_side_by_side(sketch, network, left)
    text = "x, y, z, pitch, yaw,\neach scaled to [-1, 1]"
    numbers = sketch.block(pose.x - 2.7, 15.5, text, POSE, width=13.5, height=6.2)
    sketch.arrow(pose.bottom, (pose.x, numbers.top[1]))


def draw_side_by_side(sketch: Sketch, network: ShaftNetwork, left: float) -> Block:
    """Class, box and pose from one map; returns the pose's block."""
    feature = sketch.block(left + 13, 39, "one of the six maps", MAP, width=14)
    values = {"class": CLASSES, "box": BOX_OFFSETS, "pose": network.pose_coder.values}
    for place, (name, colour) in enumerate(zip(values, (CLASS, BOX, POSE), strict=True)):
        x = left + 4.6 + 8.8 * place
        text = f"{name}\n3 x 3 conv.\n{values[name]} N"
        block = sketch.block(x, 27, text, colour, width=8.2, height=6.2)
        sketch.arrow((feature.x + 3.5 * (place - 1), feature.bottom[1]), block.top)
    return block


def draw_conditioned(sketch: Sketch, network: ShaftNetwork, left: float) -> None:
    """Architecture D: class and box are fed into the pose path."""
    title(sketch, left, 44.6, "(d)  class and box feed the pose path")
    assert isinstance(network.head, ArchitectureD)
    path = network.head.pose_paths[0]
    assert isinstance(path, ConditionedPosePath)
    feature = sketch.block(left + 13, 39, "one of the six maps", MAP, width=14)
    of_class = sketch.block(
        left + 4.2, 29.5, f"class\n3 x 3 conv.\n{CLASSES} N", CLASS, width=8.2, height=6.2
    )
    of_box = sketch.block(
        left + 13, 29.5, f"box\n3 x 3 conv.\n{BOX_OFFSETS} N", BOX, width=8.2, height=6.2
    )
    of_feature = sketch.block(
        left + 29, 29.5, normalised("3 x 3", path.from_feature.channels), LAYER, width=17
    )
    detection = sketch.block(
        left + 8.6, 20, normalised("1 x 1", path.from_detection.channels), LAYER, width=17
    )
    merge = sketch.block(left + 29, 20, normalised("3 x 3", path.merge.channels), LAYER, width=17)
    pose = sketch.block(
        left + 29, 12, f"pose: 3 x 3 conv., {network.pose_coder.values} N", POSE, width=17,
        height=3.2,
    )  # fmt: skip
    sketch.arrow((feature.x - 3.5, feature.bottom[1]), of_class.top)
    sketch.arrow(feature.bottom, of_box.top)
    sketch.arrow(feature.right, of_feature.top)
    sketch.arrow(of_class.bottom, (of_class.x + 1.5, detection.top[1]))
    sketch.arrow(of_box.bottom, (of_box.x - 1.5, detection.top[1]))
    sketch.arrow(of_feature.bottom, merge.top)
    sketch.arrow(detection.right, merge.left)
    sketch.arrow(merge.bottom, pose.top)


def draw_decoding(sketch: Sketch, network: ShaftNetwork) -> None:
    """From the outputs of any head to detections."""
    limits = yaml.safe_load((ROOT / "params.yaml").read_text())["detection"]
    texts = (
        f"class, box and pose of\n{len(network.defaults):,} default boxes",
        f"the {limits['candidates']} most\nconfident boxes",
        f"non-maximum suppression\nabove {limits['overlap']:g} IoU",
        f"boxes, scores and poses\nof up to {limits['most']} instruments",
    )
    before = None
    for place, text in enumerate(texts):
        block = sketch.block(12.5 + 25 * place, 4, text, LAYER, width=19)
        if before:
            sketch.arrow(before.right, block.left)
        before = block


def normalised(kernel: str, channels: int) -> str:
    """The text of a convolution with batch normalisation and ReLU."""
    return f"{kernel} conv., {channels}\nbatch norm., ReLU"


def title(sketch: Sketch, x: float, y: float, text: str) -> None:
    """A part's heading, from (x, y) to the right."""
    sketch.text(x, y, text, size=11.5, ha="left", weight="bold")


if __name__ == "__main__":
    main()
