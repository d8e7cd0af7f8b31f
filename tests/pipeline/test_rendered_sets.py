"""Which sets the stages render, told from the composed configuration."""

import sys
from pathlib import Path

import pytest

from tests.pipeline.conftest import ROOT
from tests.pipeline.test_configs import composed

sys.path.insert(0, str(ROOT / "pipelines"))

from real_images import STAND_IN_SETS, stand_in_settings  # noqa: E402
from render import images_per_shard, rendered_sets  # noqa: E402
from settings import size  # noqa: E402

from shaftpose.backgrounds.library import Background  # noqa: E402

LIBRARY = [Background(Path(f"{n}.jpg"), source=f"source-{n // 2}") for n in range(24)]


@pytest.mark.parametrize("probability", [0.0, 0.4, 1.0])
def test_the_users_occluder_probability_is_that_of_the_training_images(probability: float) -> None:
    config = composed("profile=smoke", f"scene.occluder_probability={probability}")
    found = {
        name: rendered.settings.scene.occluder_probability
        for name, rendered in rendered_sets(config, LIBRARY).items()
    }
    assert found == {"images": probability, "clear": 0.0, "occluded": 1.0}


def test_occluded_images_hide_a_fair_part_whatever_the_user_asks_of_training_images() -> None:
    config = composed("profile=smoke", "scene.occluder_coverage=[0.0,0.1]")
    sets = rendered_sets(config, LIBRARY)
    assert sets["images"].settings.scene.occluder_coverage == (0.0, 0.1)
    assert sets["occluded"].settings.scene.occluder_coverage == (0.2, 0.8)


def test_the_users_occluder_probability_is_not_that_of_the_stand_in() -> None:
    config = composed("profile=smoke", "scene.occluder_probability=0.9")
    found = {
        name: stand_in_settings(config, hidden).scene.occluder_probability
        for name, (_, hidden) in STAND_IN_SETS.items()
    }
    assert found == {"train": 0.3, "clear": 0.0, "occluded": 1.0}


def test_all_stand_in_images_have_the_camera_that_silhouettes_take() -> None:
    config = composed("lens.distortion.k1=[-0.3,0.1]", "lens.distortion.k2=[0,0.2]")
    bent = stand_in_settings(config, 0.0).lens.distortion
    assert bent.k1 == pytest.approx((-0.1, -0.1))
    assert bent.k2 == pytest.approx((0.1, 0.1))


def test_sets_share_no_image_and_test_sets_no_background_with_training() -> None:
    sets = rendered_sets(composed("profile=smoke"), LIBRARY)
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
    assert images_per_shard(images, size(composed("profile=smoke"))) == expected  # 20 in smoke


def test_shards_do_not_depend_on_the_number_of_workers() -> None:
    one, many = (
        rendered_sets(composed("profile=smoke", f"cluster.workers={workers}"), LIBRARY)
        for workers in (1, 32)
    )
    assert one == many
    assert [len(one[name].shards(Path())) for name in ("images", "clear", "occluded")] == [3, 2, 2]
