"""Gaps between the times of a film's frames, where damage has taken some."""

_LONGEST_STEP = 1.5  # times the usual one
_MOST_GAPS = 0.2  # of all steps; a film with more of them has no constant rate


class FilmGaps:
    """Finds gaps in a film of a constant rate.

    fps: the rate that the film states.
    """

    def __init__(self, fps: float) -> None:
        self._longest_s = _LONGEST_STEP / fps
        self._last_s, self._steps, self._gaps = 0.0, 0, 0
        self._first: tuple[float, float] | None = None

    def add(self, time_s: float) -> None:
        """Take the time of the next frame after the first one, whose time is 0."""
        self._steps += 1
        if time_s - self._last_s > self._longest_s:
            self._gaps += 1
            self._first = self._first or (self._last_s, time_s)
        self._last_s = time_s

    def __str__(self) -> str:
        """A sentence about the gaps; empty if there are none, or the rate is not constant."""
        if self._first is None or self._gaps > _MOST_GAPS * self._steps:
            return ""
        others = f", nor in {self._gaps - 1} other gaps" if self._gaps > 1 else ""
        last_s, next_s = self._first
        return f"has no frames between {last_s:.2f} and {next_s:.2f} s{others}"
