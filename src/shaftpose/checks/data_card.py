"""The data card: what rendered sets consist of, as numbers and as Markdown."""

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from shaftpose.checks.checked_image import CheckedImage
from shaftpose.core.geometry import Array
from shaftpose.figures.markdown import pipe_table
from shaftpose.settings.schema import Range, RenderSettings

# Counted items -> quantity -> axis label.
QUANTITIES = {
    "shafts": {
        "x_mm": "x [mm]",
        "y_mm": "y [mm]",
        "z_mm": "z [mm]",
        "pitch_deg": "pitch [deg]",
        "yaw_deg": "yaw [deg]",
        "visible_fraction": "visible fraction",
        "box_width_px": "width of the box [px]",
        "box_height_px": "height of the box [px]",
        "lens_distance_mm": "distance from lens to axis [mm]",
        "roughness": "roughness of the steel",
        "occluded_share": "hidden share behind occluders",
        "silhouette_iou": "IoU of mask and silhouette",
    },
    "images": {
        "light_strength": "power of the light [W]",
        "light_kelvin": "colour temperature [K]",
        "ambient": "ambient brightness",
    },
    "backgrounds": {"images_per_background": "images per background"},
}
LABELS = {name: label for labels in QUANTITIES.values() for name, label in labels.items()}

Statistics = dict[str, Any]


def ranges(settings: RenderSettings) -> dict[str, Range]:
    """The range of each quantity that is drawn at random."""
    poses, scene = settings.poses, settings.scene
    return {
        **vars(poses),
        "roughness": scene.roughness,
        "light_strength": scene.light_strength,
        "light_kelvin": scene.light_kelvin,
        "ambient": scene.ambient,
    }


def quantities(images: Sequence[CheckedImage]) -> dict[str, Array]:
    """The values (N,) of each of QUANTITIES, over N shafts, images or backgrounds in use.

    Only plain rods in images without occluders have a silhouette IoU, and only shafts behind
    occluders have a hidden share.
    """
    shafts = [shaft for image in images for shaft in image.shafts]
    found: dict[str, list[Any]] = {
        **{name: [getattr(shaft, name) for shaft in shafts] for name in QUANTITIES["shafts"]},
        **{name: [getattr(image, name) for image in images] for name in QUANTITIES["images"]},
        "images_per_background": list(Counter(image.background for image in images).values()),
    }
    return {
        name: np.array([value for value in values if value is not None], dtype=np.float64)
        for name, values in found.items()
    }


def statistics(images: Sequence[CheckedImage]) -> Statistics:
    """Counts of a set, its acceptance rate, and the minimum, median and maximum of each quantity.

    The acceptance rate is the share of drawn shafts that sampler and renderer kept, without
    crossing shafts, which are drawn separately.
    """
    shafts = sum(len(image.shafts) for image in images)
    kept = sum(len(image.shafts) - image.crossing for image in images)
    drawn = sum(image.tries for image in images if image.shafts)
    by_shafts = Counter(len(image.shafts) for image in images)
    return {
        "images": len(images),
        "images_by_shafts": {str(count): by_shafts[count] for count in sorted(by_shafts)},
        "shafts": shafts,
        "backgrounds": len({image.background for image in images}),
        "sources": len({image.source for image in images}),
        "drawn_shafts": drawn,
        "acceptance_rate": kept / drawn if drawn else None,
        "quantities": {
            name: _describe(values) for name, values in quantities(images).items() if len(values)
        },
    }


def _describe(values: Array) -> dict[str, float]:
    return {
        name: round(float(function(values)), 4)
        for name, function in (("min", np.min), ("median", np.median), ("max", np.max))
    }


def to_markdown(
    sets: Mapping[str, Statistics],
    drawn_from: Mapping[str, Range],
    pictures: Mapping[str, str],
) -> str:
    """The card: a table of all sets, a table of quantities for each set, and pictures.

    drawn_from: see `ranges`; pictures: title -> path relative to the card.
    """
    blocks = [
        "# Data card",
        "Stage `validate` has checked every image of these sets.",
        "Where the pictures at the end are missing, `dvc repro validate` draws them.",
        pipe_table(
            ["set", "images", "shafts", "backgrounds", "sources", "drawn shafts", "kept of drawn"],
            [_set_row(name, found) for name, found in sets.items()],
        ),
    ]
    blocks += [f"## {name}\n\n{_quantity_table(found, drawn_from)}" for name, found in sets.items()]
    blocks += [f"## {title}\n\n![{title}]({file})" for title, file in pictures.items()]
    return "\n\n".join(blocks) + "\n"


def _quantity_table(found: Statistics, drawn_from: Mapping[str, Range]) -> str:
    rows = [
        [LABELS[name], *(f"{value:g}" for value in values.values()), _range(drawn_from.get(name))]
        for name, values in found["quantities"].items()
    ]
    return pipe_table(["quantity", "least", "median", "greatest", "drawn from"], rows)


def _set_row(name: str, found: Statistics) -> list[str]:
    rate = found["acceptance_rate"]
    counts = ("images", "shafts", "backgrounds", "sources", "drawn_shafts")
    return [name, *(str(found[count]) for count in counts), "" if rate is None else f"{rate:.3f}"]


def _range(ends: Range | None) -> str:
    return f"{ends[0]:g} to {ends[1]:g}" if ends else ""
