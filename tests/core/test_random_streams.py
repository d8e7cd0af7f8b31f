import subprocess
import sys

import numpy as np

from shaftpose.core.random_streams import streams


def test_known_answers() -> None:
    """Other numbers here would change every image."""
    assert streams(5, 0)("light").integers(2**31, size=3).tolist() == [
        1862612745,
        2035533814,
        336216361,
    ]
    assert streams(5, 0)("films").random() == 0.14383223981523807


def test_a_stream_depends_on_all_numbers_and_the_name() -> None:
    seeds = [(5,), (6,), (5, 1), (1, 5), (5, 1, 1)]
    drawn = [streams(*seed)(name).random() for seed in seeds for name in ("light", "lens")]
    assert len(set(drawn)) == len(drawn)


def test_a_stream_does_not_depend_on_the_use_of_others() -> None:
    alone, among_others = streams(5, 3), streams(5, 3)
    among_others("poses").random(100)
    np.testing.assert_array_equal(alone("light").random(9), among_others("light").random(9))


def test_processes_agree_on_a_stream() -> None:
    script = "from shaftpose.core.random_streams import streams; print(streams(5, 3)('a').random())"
    printed = {subprocess.check_output([sys.executable, "-c", script]) for _ in range(2)}
    assert printed == {f"{streams(5, 3)('a').random()}\n".encode()}
