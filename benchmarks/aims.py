"""Targets of measured values."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Aim:
    """Target of a measured value: at least `least`, or less than `below`."""

    title: str
    least: float = float("-inf")
    below: float = float("inf")

    def is_met(self, value: float) -> bool:
        """Whether a value meets the target."""
        return self.least <= value < self.below

    def verdict(self, value: float) -> str:
        """Whether a value meets the target, in a word."""
        return "met" if self.is_met(value) else "missed"

    def __str__(self) -> str:
        return f"< {self.below:g}" if self.below < float("inf") else f">= {self.least:g}"
