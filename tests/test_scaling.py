import pytest

from shaftpose.core.errors import InputError
from shaftpose.settings.scaling import block_counts, check_width, scale_channels


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


def test_a_depth_that_gives_a_stage_no_block_is_refused() -> None:
    with pytest.raises(InputError, match=r"depth = 0.15 .* \(1, 1, 0\) .* gives 1, 2 and 1"):
        block_counts(0.15)


def test_a_width_below_the_stems_least_is_refused() -> None:
    check_width(0.1875)
    with pytest.raises(InputError, match=r"width = 0.125 .* 4 .* 8; 0.25 gives enough"):
        check_width(0.125)
