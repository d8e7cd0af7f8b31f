"""What is wanted of the renderer."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Aim:
    """What is wanted of a measured value: at least `least`, or less than `below`."""

    title: str
    least: float = float("-inf")
    below: float = float("inf")

    def is_met(self, value: float) -> bool:
        """Whether a value is as wanted."""
        return self.least <= value < self.below

    def verdict(self, value: float) -> str:
        """Whether a value is as wanted, in a word."""
        return "met" if self.is_met(value) else "missed"

    def __str__(self) -> str:
        return f"< {self.below:g}" if self.below < float("inf") else f">= {self.least:g}"


AIMS = {
    "images_per_s": Aim("images/s of two workers, start included", least=10),
    "psnr_db": Aim("PSNR inside the masks, before JPEG, dB", least=38),
    "speedup_vs_plain": Aim("times as fast as a plain script", least=15),
    "two_worker_speedup": Aim("two workers as fast as so many", least=1.8),
    "rss_growth": Aim("growth of a worker's memory", below=0.05),
    "rss_mib": Aim("peak memory of a worker, MiB", below=1024),
}
