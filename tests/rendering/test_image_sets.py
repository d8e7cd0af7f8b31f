"""The sets that the stages render, from the composed configuration."""

from pathlib import Path

import pytest

from shaftpose.core.background_index import Background
from shaftpose.rendering.image_sets import images_per_shard, rendered_sets
from shaftpose.rendering.rendered_set import RenderedSet
from shaftpose.rendering.stand_in_sets import SETS, with_occlusion
from tests.pipeline.conftest import settings_with

LIBRARY = [Background(Path(f"{n}.jpg"), source=f"source-{n // 2}") for n in range(24)]


def sets_with(*overrides: str) -> dict[str, RenderedSet]:
    settings = settings_with("profile=smoke", *overrides)
    held_out = settings.backgrounds.held_out
    return rendered_sets(settings.rendering, settings.size, LIBRARY, held_out, settings.seed)


@pytest.mark.parametrize("probability", [0.0, 0.4, 1.0])
def test_the_users_occluder_probability_is_that_of_the_training_images(probability: float) -> None:
    found = {
        name: rendered.settings.scene.occluder_probability
        for name, rendered in sets_with(f"scene.occluder_probability={probability}").items()
    }
    assert found == {"images": probability, "clear": 0.0, "occluded": 1.0}


def test_occluded_images_hide_a_fair_part_whatever_the_user_asks_of_training_images() -> None:
    sets = sets_with("scene.occluder_coverage=[0.0,0.1]")
    assert sets["images"].settings.scene.occluder_coverage == (0.0, 0.1)
    assert sets["occluded"].settings.scene.occluder_coverage == (0.2, 0.8)


def test_the_users_occluder_probability_is_not_that_of_the_stand_in() -> None:
    settings = settings_with("scene.occluder_probability=0.9").stand_in
    found = {
        name: with_occlusion(settings, hidden).scene.occluder_probability
        for name, (_, hidden) in SETS.items()
    }
    assert found == {"train": 0.3, "clear": 0.0, "occluded": 1.0}


def test_all_stand_in_images_have_the_camera_that_silhouettes_take() -> None:
    settings = settings_with("lens.distortion.k1=[-0.3,0.1]", "lens.distortion.k2=[0,0.2]")
    bent = with_occlusion(settings.stand_in, 0.0).lens.distortion
    assert bent.k1 == pytest.approx((-0.1, -0.1))
    assert bent.k2 == pytest.approx((0.1, 0.1))


def test_sets_share_no_image_and_test_sets_no_background_with_training() -> None:
    sets = sets_with()
    assert len({rendered.seed for rendered in sets.values()}) == len(sets)
    held = set(sets["clear"].backgrounds.values())
    assert held == set(sets["occluded"].backgrounds.values())
    assert held.isdisjoint(sets["images"].backgrounds.values())
    assert sum(len(sets[name].backgrounds) for name in ("images", "clear")) == len(LIBRARY)


@pytest.mark.parametrize(
    ("images", "expected"),
    [(1, 1), (2, 1), (5, 3), (39, 20), (40, 20), (41, 20), (60, 20)],
)
def test_a_set_of_two_images_or_more_is_two_shards_or_more(images: int, expected: int) -> None:
    assert images_per_shard(images, settings_with("profile=smoke").size) == expected  # 20 in smoke


def test_shards_do_not_depend_on_the_number_of_workers() -> None:
    one, many = (sets_with(f"cluster.workers={workers}") for workers in (1, 32))
    assert one == many
    assert [len(one[name].shards(Path())) for name in ("images", "clear", "occluded")] == [3, 2, 2]
