"""The painted surface of coated shafts."""

from dataclasses import replace

import numpy as np

from shaftpose.rendering.coatings import coating_picture
from shaftpose.rendering.scene import Coating, Steel

STEEL = Steel(grey=0.6, roughness=0.2, scratches=0.2, grain=4.0)
BLACK = Coating(rgb=(0.01, 0.011, 0.012), roughness=0.4, bare_mm=2.0, marks_seed=3)


def test_the_picture_covers_the_shaft_and_ends_in_bare_metal() -> None:
    picture = coating_picture(BLACK, STEEL, diameter_mm=3.0, length_mm=150.0)
    assert picture.shape == (750, 47, 4)  # 5 px per mm
    np.testing.assert_allclose(picture[:10, :, :3], 0.6)  # 2 mm
    assert np.all(picture[:10, :, 3] == 1) and not picture[10:, :, 3].any()
    np.testing.assert_allclose(picture[500, 0, :3], BLACK.rgb)  # beyond all marks


def test_seeds_give_different_marks_of_contrasting_colour() -> None:
    white = replace(BLACK, rgb=(0.3, 0.3, 0.3), bare_mm=0.0)
    for coating, lighter in ((BLACK, True), (white, False)):
        marked = []
        for seed in range(20):
            picture = coating_picture(replace(coating, marks_seed=seed), STEEL, 3.0, 150.0)
            rest = picture[picture[..., 3] == 0][:, 0]
            marks = rest[rest != rest[-1]]
            assert np.all((marks > coating.rgb[0]) == lighter)
            marked.append(len(marks))
            # The last mark begins within 50 mm; a word takes less than another 40 mm.
            np.testing.assert_allclose(picture[450:, :, :3], coating.rgb[0], rtol=0.3)
        assert len(set(marked)) > 10
        assert np.median(marked) < 0.2 * 750 * 47


def test_a_short_shaft_has_room_for_no_mark_and_is_painted_all_the_same() -> None:
    for seed in range(20):
        short = replace(BLACK, marks_seed=seed)
        assert coating_picture(short, STEEL, 3.0, 5.0).shape == (25, 47, 4)


def test_equal_coatings_look_alike() -> None:
    one, other = (coating_picture(BLACK, STEEL, 3.0, 150.0) for _ in range(2))
    np.testing.assert_array_equal(one, other)
