"""The data card's numbers against hand-computed values."""

import numpy as np
import pytest

from shaftpose.checks.checked_image import CheckedImage, CheckedShaft
from shaftpose.checks.data_card import LABELS, quantities, ranges, statistics, to_markdown
from tests.checks.rendered_sets import settings


def shaft(x_mm: float, iou: float | None, occluded: float | None = None) -> CheckedShaft:
    return CheckedShaft(
        x_mm=x_mm, y_mm=0.0, z_mm=20.0, pitch_deg=70.0, yaw_deg=90.0, visible_fraction=1.0,
        box_width_px=50, box_height_px=20, lens_distance_mm=12.0, roughness=0.2,
        occluded_share=occluded, silhouette_iou=iou,
    )  # fmt: skip


def image(
    key: str, background: str, tries: int, *shafts: CheckedShaft, crossing: int = 0
) -> CheckedImage:
    source = f"source of {background[0]}"
    return CheckedImage(
        key, b"", background, source, 7, 0, tries, crossing, 2000.0, 5000.0, 1.0, shafts
    )


IMAGES = [
    image("000000000", "a1", 6, shaft(-3.0, 0.98), shaft(5.0, 0.99)),
    image("000000001", "a2", 4, shaft(2.0, None, occluded=0.4)),
    image("000000002", "b1", 1),  # has no drawn shafts
    image("000000003", "a1", 6, shaft(1.0, 1.0)),
]


def test_statistics_by_hand() -> None:
    card = statistics(IMAGES)
    assert card["images"] == 4
    assert card["images_by_shafts"] == {"0": 1, "1": 2, "2": 1}
    assert (card["shafts"], card["backgrounds"], card["sources"]) == (4, 3, 2)
    assert (card["drawn_shafts"], card["acceptance_rate"]) == (16, 0.25)
    assert card["quantities"]["x_mm"] == {"min": -3.0, "median": 1.5, "max": 5.0}
    assert card["quantities"]["silhouette_iou"] == {"min": 0.98, "median": 0.99, "max": 1.0}
    assert card["quantities"]["occluded_share"] == {"min": 0.4, "median": 0.4, "max": 0.4}
    assert card["quantities"]["images_per_background"] == {"min": 1.0, "median": 1.0, "max": 2.0}
    assert card["quantities"].keys() == LABELS.keys()


def test_shafts_that_cross_are_not_among_those_drawn() -> None:
    shafts = shaft(-3.0, 0.98), shaft(5.0, 0.99), shaft(2.0, 1.0)
    card = statistics([image("000000000", "a1", 8, *shafts, crossing=1), IMAGES[2]])
    assert (card["shafts"], card["drawn_shafts"], card["acceptance_rate"]) == (3, 8, 0.25)


def test_images_without_shafts_have_quantities_of_images_alone() -> None:
    card = statistics(IMAGES[2:3])
    assert card["acceptance_rate"] is None
    assert card["quantities"].keys() == {
        "light_strength", "light_kelvin", "ambient", "images_per_background",
    }  # fmt: skip


def test_quantities_keep_the_order_of_shafts() -> None:
    np.testing.assert_array_equal(quantities(IMAGES)["x_mm"], [-3.0, 5.0, 2.0, 1.0])
    np.testing.assert_array_equal(quantities(IMAGES)["silhouette_iou"], [0.98, 0.99, 1.0])


def test_ranges_are_those_of_the_settings() -> None:
    found = ranges(settings())
    assert found["pitch_deg"] == (50.0, 90.0)
    assert found["light_kelvin"] == (4500.0, 8000.0)
    assert found.keys() < LABELS.keys()


@pytest.mark.parametrize(
    "line",
    [
        "| images | 4 | 4 | 3 | 2 | 16 | 0.250 |",
        "| none | 0 | 0 | 0 | 0 | 0 |  |",
        "| x [mm] | -3 | 1.5 | 5 | -20 to 20 |",
        "| visible fraction | 1 | 1 | 1 |  |",
        "| hidden share behind occluders | 0.4 | 0.4 | 0.4 |  |",
        "Where the pictures at the end are missing, `dvc repro validate` draws them.",
        "![Sheet](figures/sheet.jpg)",
    ],
)
def test_markdown_has_the_line(line: str) -> None:
    sets = {"images": statistics(IMAGES), "none": statistics([])}
    text = to_markdown(sets, ranges(settings()), {"Sheet": "figures/sheet.jpg"})
    assert line in text.splitlines()
