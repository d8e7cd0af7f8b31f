"""Images per second of the real path: Dask workers, shards, compositing, annotations, JPEG."""

from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter
from typing import Any

from distributed import Client

from benchmarks.rendering.common import SCRATCH, parameters
from shaftpose.config import ClusterSettings, parse
from shaftpose.rendering.cluster import connect
from shaftpose.rendering.jobs import RenderedSet
from shaftpose.rendering.scale_out import render_set

WORKERS = 2


@dataclass(frozen=True)
class Block:
    """One run: its images, a shard for each worker.

    start_s: until each worker has finished one image: scheduler, workers, Blender. wall_s: of the
    whole run. rate: images/s after the start.
    """

    images: int
    bytes: int
    start_s: float
    wall_s: float
    rate: float


def measure(rendered: RenderedSet, images: int) -> dict[str, Any]:
    """`images` by two workers; before and after it half of them by one, so that a machine that
    grows slower or faster meanwhile does so for both."""
    share = images // WORKERS
    return summary(*(_block(rendered, workers, share) for workers in (1, WORKERS, 1)))


def summary(before: Block, together: Block, after: Block) -> dict[str, Any]:
    """What a run of all workers and two of one say, one before and one after it."""
    alone_rate = 2 / (1 / before.rate + 1 / after.rate)  # of equal numbers of images
    return {
        "images_per_s": together.images / together.wall_s,
        "two_worker_speedup": together.rate / alone_rate,
        "bytes_per_image": together.bytes / together.images,
        "steady_images_per_s": {"1": alone_rate, str(WORKERS): together.rate},
        "start_s": together.start_s,
        "images": together.images,
        "images_per_shard": before.images,
    }


def _block(rendered: RenderedSet, workers: int, share: int) -> Block:
    local = {"workers": workers, "address": None, "slurm": None}
    cluster = parse(ClusterSettings, parameters()["cluster"] | local, "params.yaml: cluster")
    hang_s = cluster.hang_s
    with TemporaryDirectory(dir=SCRATCH) as name:
        folder, start = Path(name), perf_counter()
        with connect(cluster) as client:
            connect_s = perf_counter() - start
            first_s = _seconds(_part(rendered, workers, 1), folder / "first", client, hang_s)
            all_s = _seconds(_part(rendered, workers, share), folder / "all", client, hang_s)
        return Block(
            images=workers * share,
            bytes=sum(path.stat().st_size for path in (folder / "all/out").iterdir()),
            start_s=connect_s + first_s,
            wall_s=connect_s + all_s,
            rate=workers * (share - 1) / (all_s - first_s),
        )


def _part(rendered: RenderedSet, shards: int, size: int) -> RenderedSet:
    return replace(rendered, images=shards * size, images_per_shard=size)


def _seconds(rendered: RenderedSet, folder: Path, client: Client, hang_s: float) -> float:
    """How long it takes to render a set from nothing."""
    start = perf_counter()
    render_set(rendered, folder / "scratch", folder / "out", client, hang_s)
    return perf_counter() - start
