"""Image quality relative to a reference with very many samples, and its cost."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.rendering.common import (
    SAMPLES,
    SCRATCH,
    in_processes,
    quiet_generator,
    with_samples,
)
from shaftpose.core.samples import Sample
from shaftpose.rendering.rendered_set import RenderedSet

_PROCESSES = 2


@dataclass(frozen=True)
class Task:
    """Images of a set for one process; its number of samples must stay the same.

    references: folder of the reference images to compare with or to write.
    """

    rendered: RenderedSet
    indices: range
    references: Path


def measure(
    rendered: RenderedSet, poses: int, reference_samples: int, sample_counts: Iterable[int]
) -> dict[str, Any]:
    """Median PSNR over `poses` images inside the visible masks, before JPEG compression, by number
    of samples, with the median seconds per image on one core."""
    references = _references(with_samples(rendered, reference_samples), poses)
    tasks = [
        Task(with_samples(rendered, samples), range(poses), references)
        for samples in sorted({*sample_counts, SAMPLES})
    ]
    curve = in_processes(_compare, tasks, at_once=1)
    (own,) = (point for point in curve if point["samples"] == SAMPLES)
    return {
        "psnr_db": own["psnr_db"],
        "curve": curve,
        "poses": poses,
        "reference_samples": reference_samples,
    }


def _references(rendered: RenderedSet, poses: int) -> Path:
    """Folder with the first `poses` images, reused by runs with the same software."""
    folder = SCRATCH / f"reference-{rendered.fingerprint()}"
    folder.mkdir(parents=True, exist_ok=True)
    tasks = [Task(rendered, range(n, poses, _PROCESSES), folder) for n in range(_PROCESSES)]
    in_processes(_write_references, tasks, at_once=_PROCESSES)
    return folder


def _write_references(task: Task) -> None:
    missing = [index for index in task.indices if not _path(task, index).exists()]
    for sample, _ in _samples(task.rendered, missing):
        path = _path(task, int(sample.key))
        part = path.with_suffix(".part.npz")
        np.savez_compressed(part, rgb=sample.rgb, mask=_mask(sample))
        part.replace(path)


def _compare(task: Task) -> dict[str, Any]:
    """One point of the curve."""
    found, seconds = [], []
    for sample, taken in _samples(task.rendered, task.indices):
        with np.load(_path(task, int(sample.key))) as reference:
            found.append(psnr_db(sample.rgb, reference["rgb"], reference["mask"]))
        seconds.append(taken)
    return {
        "samples": task.rendered.settings.samples[0],
        "psnr_db": median(found),
        "psnr_db_least": min(found),
        "seconds": median(seconds),
    }


def _samples(rendered: RenderedSet, indices: Iterable[int]) -> Iterator[tuple[Sample, float]]:
    """Images and the seconds for each."""
    with quiet_generator(rendered) as generator:
        for index in indices:
            start = perf_counter()
            sample = generator.sample(index)
            yield sample, perf_counter() - start


def _path(task: Task, index: int) -> Path:
    return task.references / f"{index:06d}.npz"


def _mask(sample: Sample) -> NDArray[np.bool_]:
    """Visible mask (H, W) of all shafts."""
    mask: NDArray[np.bool_] = np.any([i.mask for i in sample.instruments], axis=0)
    return mask


def psnr_db(
    image: NDArray[np.uint8], reference: NDArray[np.uint8], mask: NDArray[np.bool_]
) -> float:
    """10 log10(255^2 / mean squared difference) of (H, W, 3) inside a mask (H, W)."""
    difference = image[mask].astype(float) - reference[mask]
    return float(10 * np.log10(255**2 / np.mean(difference**2)))
