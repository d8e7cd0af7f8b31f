"""Images per second of the full path: Dask workers, shards, compositing, annotations, JPEG."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import mean
from tempfile import TemporaryDirectory
from time import time
from typing import Any

from distributed import Client

from benchmarks.rendering.common import SCRATCH, default_settings
from shaftpose.core.shard_index import shard_paths
from shaftpose.farm.cluster import cluster_client
from shaftpose.farm.render_sets import render_set
from shaftpose.rendering.rendered_set import RenderedSet

WORKERS = 2


@dataclass(frozen=True)
class Block:
    """One run of workers with a shard each; times in s.

    start_s: until each worker has finished one image (scheduler, workers, Blender). wall_s: whole
    run. shards_s: each shard, without the start.
    """

    start_s: float
    wall_s: float
    shards_s: list[float]


def measure(rendered: RenderedSet, images: int) -> dict[str, Any]:
    """Speed of two workers, with half of `images` each. One worker renders the first half before
    and the second half after that, so that a drift of the machine's speed affects both."""
    share = images // WORKERS
    whole = _part(rendered, WORKERS, share)
    with TemporaryDirectory(dir=SCRATCH) as name:
        folder = Path(name)
        before = _block(_part(rendered, 1, share), folder / "half", workers=1)
        together = _block(whole, folder / "whole", WORKERS)
        shards = whole.shards(folder / "whole/scratch" / whole.fingerprint())
        size = sum(shard.path.stat().st_size for shard in shards)
        shards[-1].path.unlink()  # the only shard missing in the next run
        after = _block(whole, folder / "whole", workers=1)
    speeds = summary(share, together, [before, after])
    return {**speeds, "bytes_per_image": size / (WORKERS * share)}


def summary(share: int, together: Block, alone: Sequence[Block]) -> dict[str, Any]:
    """Speeds from a run of all workers and from runs of each shard by one worker alone.

    share: images per shard. With only two shards, the faster worker idles at the end, unlike with
    many. Speeds after the start are therefore based on the times of shards.
    """
    together_s = mean(together.shards_s)
    alone_s = mean(seconds for block in alone for seconds in block.shards_s)
    return {
        "images_per_s": WORKERS * share / together.wall_s,
        "two_worker_speedup": WORKERS * alone_s / together_s,
        "steady_images_per_s": {
            "1": (share - 1) / alone_s,
            str(WORKERS): WORKERS * (share - 1) / together_s,
        },
        "start_s": together.start_s,
        "images": WORKERS * share,
        "images_per_shard": share,
    }


def _block(rendered: RenderedSet, folder: Path, workers: int) -> Block:
    """Render the missing shards of a set in `folder`, one per worker."""
    cluster = replace(default_settings().cluster, workers=workers, address=None, slurm=None)
    start = time()
    with cluster_client(cluster) as client:
        connected = time()
        with TemporaryDirectory(dir=SCRATCH) as first:
            _render(_part(rendered, workers, 1), Path(first), client, cluster.hang_s)
        begun = time()
        ends = _render(rendered, folder, client, cluster.hang_s)
        first_s = begun - connected
        return Block(
            start_s=connected - start + first_s,
            wall_s=connected - start + time() - begun,
            shards_s=[end - begun - first_s for end in ends if end > begun],
        )


def _part(rendered: RenderedSet, shards: int, size: int) -> RenderedSet:
    return replace(rendered, images=shards * size, images_per_shard=size)


def _render(rendered: RenderedSet, folder: Path, client: Client, hang_s: float) -> list[float]:
    """Render the missing shards of a set; returns the end time of each shard, s since 1970."""
    render_set(rendered, folder / "scratch", folder / "out", client, hang_s)
    return [path.stat().st_mtime for path in shard_paths(folder / "out")]
