"""Renders a set shard by shard on Dask workers, and survives interruption."""

import logging
from collections.abc import Iterable, Sequence
from concurrent.futures import CancelledError
from pathlib import Path
from threading import Lock
from typing import Any

from distributed import Client, Future, KilledWorker, as_completed
from tqdm import tqdm

from shaftpose.errors import InputError
from shaftpose.files import naming_full_disk
from shaftpose.rendering.jobs import RenderedSet, Shard, link_shards, software, write_set
from shaftpose.rendering.locks import alone_in
from shaftpose.rendering.shard_task import Run, render_shard

ATTEMPTS = 3  # at a shard whose Blender crashes or hangs

logger = logging.getLogger(__name__)


def render_set(
    rendered: RenderedSet, scratch: Path, out: Path, client: Client, hang_s: float
) -> None:
    """Render what is not yet in `scratch`, then link all shards into `out`.

    client: of workers that find `scratch` and the backgrounds under the same paths. hang_s: Blender
    is killed, and its shard tried again, after so many seconds without a finished image.

    Run again after an interruption, it continues with the shards that are unfinished or have been
    cut short since; the result is byte-identical to an undisturbed run. Raises InputError if a
    shard fails, naming its log, if a disk is full, and if another run is at the same set or in
    the same `out`.
    """
    folder = scratch.resolve() / rendered.fingerprint()
    with naming_full_disk(folder), alone_in(folder, scratch), alone_in(out, scratch):
        folder.mkdir(exist_ok=True)
        shards = rendered.shards(folder)
        missing = [shard for shard in shards if not _is_finished(shard)]
        logger.info("%d of %d shards are to be rendered in %s", len(missing), len(shards), folder)
        write_set(rendered, folder)
        _render(missing, Run(software(), str(folder), hang_s), client)
        with naming_full_disk(out):
            link_shards(shards, out)


def _is_finished(shard: Shard) -> bool:
    """Whether a shard can be used as it is. A shard in `out` is the same file under another name:
    whoever cuts that one short has cut this one."""
    finished = shard.is_finished()
    if shard.path.exists() and not finished:
        logger.warning("%s is truncated or damaged: rendering it again", shard.path)
    return finished


def _render(shards: Sequence[Shard], run: Run, client: Client) -> None:
    total = sum(shard.count for shard in shards)
    with tqdm(total=total, desc="rendering", unit="image", disable=not total) as bar:
        progress = _Progress(bar)
        client.subscribe_topic(run.topic, progress.on_event)
        futures = client.map(render_shard, shards, run=run, pure=False, retries=ATTEMPTS - 1)
        try:
            tasks = as_completed(futures, loop=client.loop)
            _await(tasks, dict(zip(futures, shards, strict=True)), progress)
        finally:
            client.cancel(futures)  # their tasks end Blender
            client.unsubscribe_topic(run.topic)


def _await(tasks: Iterable[Future], shards: dict[Future, Shard], progress: "_Progress") -> None:
    """Wait until all tasks are done; raises InputError at the first failure."""
    for future in tasks:
        shard = shards[future]
        try:
            complaint = future.result()
        except KilledWorker as error:
            raise InputError(
                f"{shard.path.name}: each of the Dask workers that had it died; see {shard.log}"
            ) from error
        except CancelledError as error:
            raise InputError(
                "the connection to the Dask scheduler is lost; run it again to continue"
            ) from error
        if complaint:
            raise InputError(complaint)
        progress.show(shard.path.name, shard.count)


class _Progress:
    """Shows how many images are finished, of whole shards and of those that are being rendered."""

    def __init__(self, bar: Any) -> None:
        self._bar, self._lock = bar, Lock()  # events come from a thread of Dask's client
        self._images: dict[str, int] = {}
        self._said: set[str] = set()

    def on_event(self, event: tuple[float, dict[str, Any]]) -> None:
        """Take what a task reports."""
        _, report = event
        trouble = report.get("trouble", "")
        if trouble and trouble not in self._said:  # many shards may have the same
            logger.warning("%s", trouble)
            self._said.add(trouble)
        self.show(report["shard"], report.get("images", 0))

    def show(self, shard: str, images: int) -> None:
        """Set the number of finished images of a shard; a second attempt starts anew."""
        with self._lock:
            self._bar.update(images - self._images.get(shard, 0))
            self._images[shard] = images
