"""Targets of the renderer."""

from benchmarks.aims import Aim

AIMS = {
    "images_per_s": Aim("images/s of two workers, start included", least=10),
    "psnr_db": Aim("PSNR inside the masks, before JPEG, dB", least=38),
    "speedup_vs_plain": Aim("times as fast as a plain script", least=15),
    "two_worker_speedup": Aim("speed of two workers, relative to one", least=1.8),
    "rss_growth": Aim("growth of a worker's memory", below=0.05),
    "rss_mib": Aim("peak memory of a worker, MiB", below=1024),
}
