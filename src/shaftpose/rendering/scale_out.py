"""Renders a set with several worker processes, shard by shard, and survives interruption."""

import logging
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor, as_completed
from pathlib import Path
from typing import Any

from tqdm import tqdm

from shaftpose.config import to_json
from shaftpose.errors import InputError
from shaftpose.rendering.jobs import RenderedSet, Shard, link_shards
from shaftpose.rendering.worker import IMAGE_DONE, Job

logger = logging.getLogger(__name__)


def render_set(rendered: RenderedSet, scratch: Path, out: Path, workers: int) -> None:
    """Render what is not yet in `scratch`, then link all shards into `out`.

    Run again after an interruption, it continues with the unfinished shards; the result is
    byte-identical to an undisturbed run. Raises InputError if a worker fails, naming its log.
    """
    folder = scratch / rendered.fingerprint()
    folder.mkdir(parents=True, exist_ok=True)
    shards = rendered.shards(folder)
    missing = [shard for shard in shards if not shard.path.exists()]
    logger.info("%d of %d shards are to be rendered in %s", len(missing), len(shards), folder)
    _render(rendered, missing, workers)
    link_shards(shards, out)


def _render(rendered: RenderedSet, shards: list[Shard], workers: int) -> None:
    total = sum(shard.count for shard in shards)
    processes: list[subprocess.Popen[str]] = []
    with (
        tqdm(total=total, desc="rendering", unit="image", disable=not total) as bar,
        ThreadPoolExecutor(max_workers=max(1, workers)) as pool,
    ):
        futures = [pool.submit(_run_worker, rendered, s, bar, processes) for s in shards]
        try:
            for future in as_completed(futures):
                future.result()
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            # A thread may be starting its next worker just now: repeat until none is left.
            while not all(future.done() for future in futures):
                for process in processes:
                    process.terminate()
                time.sleep(0.05)
            raise


def _run_worker(
    rendered: RenderedSet, shard: Shard, bar: Any, processes: list[subprocess.Popen[str]]
) -> None:
    job_file = shard.path.with_suffix(".json")
    job_file.write_text(to_json(_job(rendered, shard)))
    command = [sys.executable, "-m", "shaftpose.rendering.worker", str(job_file)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    processes.append(process)
    complaint = ""
    for line in process.stdout or ():
        if line.strip() == IMAGE_DONE:
            bar.update()
        else:
            complaint = line.strip().removeprefix("error: ")
    if process.wait() != 0:
        log = job_file.with_suffix(".log")
        raise InputError(complaint or f"rendering {shard.path.name} failed; see {log}")


def _job(rendered: RenderedSet, shard: Shard) -> Job:
    return Job(
        settings=rendered.settings,
        backgrounds=dict(rendered.backgrounds),
        seed=rendered.seed,
        first=shard.first,
        count=shard.count,
        path=shard.path,
    )
