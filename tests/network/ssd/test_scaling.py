from typing import get_type_hints

import pytest
from pydantic import TypeAdapter, ValidationError

from shaftpose.network.ssd.scaling import STEM_CHANNELS, block_counts, scale_channels
from shaftpose.settings.schema import RunSize


def test_width_rounds_to_multiples_of_four() -> None:
    assert scale_channels(224, 0.25) == 56
    assert scale_channels(96, 0.3) == 28  # 28.8 is closer to 28 than to 32
    assert scale_channels(32, 0.01) == 4
    assert scale_channels(70, 1.0) == 70


@pytest.mark.parametrize(
    ("depth", "blocks"),
    [(1.0, (4, 7, 3)), (0.25, (1, 2, 1)), (0.5, (2, 4, 2)), (2.0, (8, 14, 6))],
)
def test_depth_scales_the_blocks(depth: float, blocks: tuple[int, ...]) -> None:
    assert block_counts(depth) == blocks


def test_the_least_sizes_of_the_settings_give_a_network_that_can_learn() -> None:
    width, depth = (get_type_hints(RunSize, include_extras=True)[key] for key in ("width", "depth"))
    assert scale_channels(STEM_CHANNELS, TypeAdapter(width).validate_python(0.1875)) == 8
    assert block_counts(TypeAdapter(depth).validate_python(0.17)) == (1, 1, 1)
    assert scale_channels(STEM_CHANNELS, 0.187) < 8 and 0 in block_counts(0.16)
    for kind, less in ((width, 0.187), (depth, 0.16)):
        with pytest.raises(ValidationError):
            TypeAdapter(kind).validate_python(less)
