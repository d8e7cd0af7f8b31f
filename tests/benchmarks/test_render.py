"""The rendering benchmark's own arithmetic, and the scenes it compares itself on."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks.render import AIMS, table
from benchmarks.rendering import profile
from benchmarks.rendering.quality import psnr_db

MET: dict[str, Any] = {
    "images_per_s": 10.0, "psnr_db": 38.0, "speedup_vs_plain": 15.0, "two_worker_speedup": 1.8,
    "rss_growth": 0.049, "rss_mib": 1023.0,
}  # fmt: skip
MISSED: dict[str, Any] = {
    "images_per_s": 9.99, "psnr_db": 37.9, "speedup_vs_plain": 14.9, "two_worker_speedup": 1.79,
    "rss_growth": 0.05, "rss_mib": 1024.0,
}  # fmt: skip


def test_psnr_by_hand_and_inside_the_mask_alone() -> None:
    reference = np.full((2, 2, 3), 100, dtype=np.uint8)
    image, mask = reference.copy(), np.array([[True, True], [False, False]])
    image[0, 0] -= 10  # half of the mask is off by 10: a mean square of 50
    image[1, 1] = 255
    assert psnr_db(image, reference, mask) == pytest.approx(10 * np.log10(255**2 / 50))


def test_aims_are_those_of_the_values_at_their_edge() -> None:
    assert AIMS.keys() == MET.keys()
    assert all(aim.is_met(MET[key]) for key, aim in AIMS.items())
    assert not any(aim.is_met(MISSED[key]) for key, aim in AIMS.items())


@pytest.mark.parametrize(("values", "word"), [(MET, "met"), (MISSED, "missed")])
def test_the_table_says_which_aims_are_met(values: dict[str, Any], word: str) -> None:
    lines = table({"parts": values})[1:]
    assert [line.split()[-1] for line in lines] == [word] * len(AIMS)


def test_the_table_of_one_part_leaves_the_others_out() -> None:
    lines = table({"memory": {"rss_growth": 0.01, "rss_mib": 400.0}})
    assert len(lines) == 3


def test_every_profiled_function_exists() -> None:
    keys = [profile._key(name) for names in profile.STEPS.values() for name in names]
    assert len(set(keys)) == len(keys) > 5
    assert all(Path(file).is_file() for file, _, _ in keys)
