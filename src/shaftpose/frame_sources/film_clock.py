"""The times of a film's frames."""

import numpy as np

_LONGEST_BACK_S = 1.0  # to an earlier time within one recording, as of frames out of order


class FilmClock:
    """Tells the times of frames in s since the first one; they never step back.

    Files of a recorder that were joined byte by byte, as those of MPEG streams may be, can each
    begin at an earlier time: their times go on from where the file before ended. If a single time
    is too early, and the next one is not, it was wrong.

    fps: the rate that the film states.
    """

    def __init__(self, fps: float) -> None:
        self._step_s = 1 / fps
        self._part_s, self._part_before_s, self._last_s = 0.0, 0.0, 0.0

    def time_s(self, stated_s: float) -> float:
        """The time of the next frame after the first one. stated_s: what the file says about it; 0
        or infinite if it states none."""
        next_s = self._last_s + self._step_s
        if not 0 < stated_s < np.inf:
            self._last_s = next_s
            return next_s
        if abs(self._part_before_s + stated_s - next_s) < _LONGEST_BACK_S:
            self._part_s = self._part_before_s
        elif self._part_s + stated_s < self._last_s - _LONGEST_BACK_S:
            self._part_before_s, self._part_s = self._part_s, next_s - stated_s
        self._last_s = max(self._part_s + stated_s, self._last_s)
        return self._last_s
