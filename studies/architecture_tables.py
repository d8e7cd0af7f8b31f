"""Write the tables of docs/architecture.md: maps, default boxes, sizes, rounding by classes.

The networks are built as in training, for the single-shot variants that learn poses, at the widths
and depths of conf/profiles.yaml. They use no memory for weights (torch's device `meta`).
"""

from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
import torch
from torch import nn
from torch.nn.functional import one_hot
from torch.utils.flop_counter import FlopCounterMode

from shaftpose.core.errors import exit_on_input_error
from shaftpose.figures.markdown import pipe_table
from shaftpose.metrics.pose_errors import errors_between
from shaftpose.metrics.table import metrics_of
from shaftpose.network.building import build_network, built
from shaftpose.network.ssd.default_boxes import BOXES_PER_CELL
from shaftpose.network.ssd.heads import BOX_OFFSETS, CLASSES
from shaftpose.network.ssd.inception_v4 import (
    EXTRA_CHANNELS,
    MAP_SIZES,
    InceptionV4Features,
    block_counts,
)
from shaftpose.network.ssd.pose_bins import BinCoder
from shaftpose.network.ssd.pose_coding import PoseCoder
from shaftpose.network.ssd.single_shot import SingleShotNetwork
from shaftpose.report.cells import cells, headings
from shaftpose.settings.compose import composed_settings
from shaftpose.settings.tree import VARIANTS, Settings, read_variant
from studies.pages import rewrite, with_tables

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs/architecture.md"
SINGLE_SHOT = ".single_shot_network"
PROFILES = ("paper", "bench", "demo")
IMAGE = (1, 3, 299, 299)
SPEEDS = (10, 30, 100)  # sustained TFLOP/s of a GPU
POSES = 20_000  # in the average of the rounding errors
ERRORS = metrics_of("pose")


def main() -> None:
    """Write the tables between the markers of the page."""
    with exit_on_input_error():
        rewrite(PAGE, page)


def page(text: str) -> str:
    """The page with its tables up to date."""
    tables = {
        "maps": map_table(), "networks": network_table(), "budget": budget_table(),
        "rounding": rounding_table(),
    }  # fmt: skip
    return with_tables(text, tables, "make architecture", "docs/architecture.md")


def map_table() -> str:
    """The six maps: how they are made, their sizes, channels and default boxes."""
    with torch.device("meta"):
        backbones = [InceptionV4Features(*size) for size in sizes().values()]
    rows = [
        [str(i + 1), stage, f"{size} x {size}", *map(str, channels), str(boxes),
         f"{size * size * boxes:,}"]
        for i, (stage, size, *channels, boxes) in enumerate(
            zip(
                stages(*(depth for _, depth in sizes().values())), MAP_SIZES,
                *(backbone.channels for backbone in backbones), BOXES_PER_CELL,
                strict=True,
            )
        )
    ]  # fmt: skip
    total = sum(size**2 * boxes for size, boxes in zip(MAP_SIZES, BOXES_PER_CELL, strict=True))
    depths = " / ".join(f"{depth:g}" for _, depth in sizes().values())
    headings = [f"Channels at width {width:g} ({names})" for names, (width, _) in sizes().items()]
    return pipe_table(
        ["Map", f"Made by, at depth {depths}", "Size", *headings, "Boxes per cell",
         "Default boxes"],
        [*rows, ["", "all", "", *[""] * len(headings), "", f"{total:,}"]],
    )  # fmt: skip


def stages(*depths: float) -> list[str]:
    """The layers between each map and the previous one, with the blocks at each depth."""
    entries = ("stem", "Reduction-A", "Reduction-B, padded")
    blocks = zip(*(block_counts(depth) for depth in depths), strict=True)
    trunk = [
        f"{entry}, {' / '.join(map(str, counts))} Inception-{letter}"
        for entry, counts, letter in zip(entries, blocks, "ABC", strict=True)
    ]
    return [*trunk, *["1 x 1, then 3 x 3 of stride 2"] * len(EXTRA_CHANNELS)]


def network_table() -> str:
    """Parameters and FLOPs of each network at each size."""
    rows = []
    for names, variant in networks().items():
        for named, size in sizes().items():
            network = build(variant, *size)
            values = network.pose_coder.values
            backbone, head = parameters(network.backbone), parameters(network.head)
            rows.append(
                [
                    names, str(values), str(CLASSES + BOX_OFFSETS + values),
                    named, *(f"{share:g}" for share in size),
                    f"{backbone:,}", f"{head:,}", f"{backbone + head:,}", f"{flops(network):.2f}",
                ]
            )  # fmt: skip
    return pipe_table(
        ["Variant", "Pose values", "Values per box", "Profile", "Width", "Depth", "Backbone",
         "Head", "Parameters", "GFLOPs"],
        rows,
    )  # fmt: skip


def budget_table() -> str:
    """Training hours with the profile `paper` at several computing speeds."""
    paper = settings("paper").size
    images, rows = paper.steps * paper.batch_size, []
    for names, variant in networks().items():
        operations = training_flops(build(variant, paper.width, paper.depth))
        hours = [operations * images / speed / 1000 / 3600 for speed in SPEEDS]
        cells = f"{operations:.1f}", f"{images:,}", *(f"{value:,.1f}" for value in hours)
        rows.append([names, *cells])
    headings = [f"Hours at {speed} TFLOP/s" for speed in SPEEDS]
    return pipe_table(["Variant", "GFLOPs per image", "Images", *headings], rows)


def rounding_table() -> str:
    """Mean errors of networks that predict pose classes, if every class is correct."""
    rows = []
    for names, variant in networks().items():
        coder = pose_coder(variant)
        if isinstance(coder, BinCoder):
            rows.append([names, *cells(rounding_errors(coder), ERRORS)])
    return pipe_table(["Variant", *headings(ERRORS)], rows)


def rounding_errors(coder: BinCoder) -> dict[str, float | None]:
    """Mean errors of the centres of the correct bins, by metric name.

    Poses are drawn uniformly from the ranges of params.yaml.
    """
    ranges = settings("paper").rendering.poses
    true = np.random.default_rng(0).uniform(ranges.low, ranges.high, (POSES, len(ranges.low)))
    right = coder.encode(torch.tensor(true, dtype=torch.float32)).unbind(-1)
    logits = [one_hot(bins, count) for bins, count in zip(right, coder.bins, strict=True)]
    decoded = coder.decode(torch.cat(logits, dim=-1))
    return errors_between(decoded.double().numpy(), true).means()


def sizes() -> dict[str, tuple[float, float]]:
    """Profiles -> width and depth of their networks; profiles of one size share a key."""
    by_size: dict[tuple[float, float], list[str]] = {}
    for name in PROFILES:
        size = settings(name).size
        by_size.setdefault((size.width, size.depth), []).append(name)
    return {", ".join(names): size for size, names in by_size.items()}


@cache
def settings(profile: str, *overrides: str) -> Settings:
    """The settings of params.yaml with this profile."""
    return composed_settings(ROOT, f"profile={profile}", *overrides)


def networks() -> dict[str, str]:
    """The names of variants with the same single-shot network -> the name of one of them.

    Variants without poses are left out, and networks of another kind.
    """
    same: dict[str, list[str]] = {}
    for path in sorted((ROOT / VARIANTS).glob("*.yaml")):
        variant = read_variant(path.stem, ROOT, settings("paper").size)
        if variant.pose_loss and variant.network["_target_"].endswith(SINGLE_SHOT):
            same.setdefault(str(variant.network), []).append(variant.name)
    return {", ".join(alike): alike[0] for alike in same.values()}


def build(variant: str, width: float, depth: float) -> SingleShotNetwork:
    """The network of a variant, without memory for its weights."""
    scale = (f"profiles.paper.width={width}", f"profiles.paper.depth={depth}")
    with torch.device("meta"):
        network = build_network(settings("paper", f"variant={variant}", *scale).variant)
    assert isinstance(network, SingleShotNetwork)
    return network.eval()


def pose_coder(variant: str) -> PoseCoder:
    """The pose coder of a variant for the ranges of params.yaml."""
    chosen = settings("paper", f"variant={variant}")
    make: Callable[..., PoseCoder] = built(chosen.variant.network["pose_coder"])
    ranges = chosen.rendering.poses
    return make(ranges.low, ranges.high)


def parameters(module: nn.Module) -> int:
    """Number of weights."""
    return sum(weights.numel() for weights in module.parameters())


def training_flops(network: nn.Module) -> float:
    """Floating point operations of a forward and backward pass for one image, in 10^9."""
    counter = FlopCounterMode(display=False)
    with counter:
        outputs = network.train()(torch.zeros(2, *IMAGE[1:], device="meta"))
        torch.cat([output.flatten() for output in outputs]).sum().backward()
    return counter.get_total_flops() / 2e9


def flops(network: nn.Module) -> float:
    """Floating point operations of a forward pass for one image, in 10^9.

    Only convolutions count, with two operations for each multiply-add.
    """
    counter = FlopCounterMode(display=False)
    with torch.no_grad(), counter:
        network(torch.zeros(IMAGE, device="meta"))
    return counter.get_total_flops() / 1e9


if __name__ == "__main__":
    main()
