"""Rendering of a set, shard by shard, on Dask workers; resumes after an interruption."""

import logging
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from threading import Lock
from typing import Any

from distributed import Client, Future, KilledWorker, as_completed
from tqdm import tqdm

from shaftpose.core.errors import InputError
from shaftpose.core.files import naming_full_disk
from shaftpose.farm.cluster import cluster_client
from shaftpose.farm.locks import alone_in
from shaftpose.farm.set_folder import link_shards, matches_checksum, write_set
from shaftpose.farm.shard_task import RunParameters, render_shard
from shaftpose.farm.workers import naming_lost_scheduler
from shaftpose.rendering.rendered_set import RenderedSet, Shard, software
from shaftpose.settings.schema import ClusterSettings

logger = logging.getLogger(__name__)


def render_sets(
    sets: Mapping[str, RenderedSet], cluster: ClusterSettings, scratch: Path, out: Path
) -> None:
    """Render each set into the subfolder of `out` with its name; see `render_set`."""
    with cluster_client(cluster) as client:
        for name, rendered in sets.items():
            render_set(rendered, scratch, out / name, client, cluster.hang_s)
            logger.info("%d images are in %s", rendered.images, out / name)


def render_set(
    rendered: RenderedSet, scratch: Path, out: Path, client: Client, hang_s: float
) -> None:
    """Render the shards missing in `scratch`, then link all shards into `out`.

    client: its workers must find `scratch` and the backgrounds under the same paths. hang_s:
    seconds without a finished image after which Blender is killed and the shard retried.

    A repeated run renders only unfinished or damaged shards; the result is byte-identical to an
    uninterrupted run. Raises InputError if a shard fails (naming its log), a disk is full, or
    another run uses the same set or the same `out`.
    """
    folder = scratch.resolve() / rendered.fingerprint()
    with naming_full_disk(folder), alone_in(folder, scratch), alone_in(out, scratch):
        folder.mkdir(exist_ok=True)
        shards = rendered.shards(folder)
        with ThreadPoolExecutor() as threads:  # which read all bytes
            finished = list(threads.map(_is_finished, shards))
        missing = [shard for shard, done in zip(shards, finished, strict=True) if not done]
        logger.info("rendering %d of %d shards in %s", len(missing), len(shards), folder)
        write_set(rendered, folder)
        with naming_lost_scheduler("run again to continue"):
            _render(missing, RunParameters(software(), str(folder), hang_s), client)
        with naming_full_disk(out):
            link_shards(shards, out)


def _is_finished(shard: Shard) -> bool:
    """Whether a shard is complete; warns if it exists but is damaged, and removes it.

    It shares its bytes with its hard link in `out`, which may have been changed there.
    """
    finished = shard.is_finished() and matches_checksum(shard.path)
    if shard.path.exists() and not finished:
        logger.warning("%s is truncated or damaged: rendering it again", shard.path)
        shard.path.unlink()
    return finished


def _render(shards: Sequence[Shard], run: RunParameters, client: Client) -> None:
    total = sum(shard.count for shard in shards)
    hidden = None if total else True  # None: where it would be written to a file
    with tqdm(total=total, desc="rendering", unit="image", disable=hidden) as bar:
        progress = _Progress(bar)
        client.subscribe_topic(run.topic, progress.on_event)
        futures = client.map(render_shard, shards, run=run, pure=False)
        try:
            tasks = as_completed(futures, loop=client.loop)
            _await(tasks, dict(zip(futures, shards, strict=True)), progress)
        finally:
            client.cancel(futures)  # cancelled tasks end Blender
            client.unsubscribe_topic(run.topic)


def _await(tasks: Iterable[Future], shards: dict[Future, Shard], progress: "_Progress") -> None:
    """Wait until all tasks are done; raises InputError at the first failure."""
    for future in tasks:
        shard = shards[future]
        try:
            future.result()
        except KilledWorker as error:
            raise InputError(
                f"{shard.path.name}: every Dask worker that rendered it died; see {shard.log}"
            ) from error
        progress.show(shard.path.name, shard.count)


class _Progress:
    """Progress bar of the finished images, including those of unfinished shards."""

    def __init__(self, bar: Any) -> None:
        self._bar, self._lock = bar, Lock()  # events come from a thread of Dask's client
        self._images: dict[str, int] = {}
        self._said: set[str] = set()

    def on_event(self, event: tuple[float, dict[str, Any]]) -> None:
        """Show the report of a task: finished images or a warning."""
        _, report = event
        trouble = report.get("trouble", "")
        if trouble and trouble not in self._said:  # many shards may report the same
            logger.warning("%s", trouble)
            self._said.add(trouble)
        self.show(report["shard"], report.get("images", 0))

    def show(self, shard: str, images: int) -> None:
        """Set the number of finished images of a shard; another attempt restarts at 0."""
        with self._lock:
            self._bar.update(images - self._images.get(shard, 0))
            self._images[shard] = images
