"""Renders a set with several worker processes, shard by shard, and survives interruption."""

import logging
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor, as_completed
from pathlib import Path
from typing import Any

from tqdm import tqdm

from shaftpose.config import to_json
from shaftpose.errors import InputError
from shaftpose.rendering.jobs import RenderedSet, Shard, link_shards
from shaftpose.rendering.worker import IMAGE_DONE, Job
from shaftpose.shards import is_whole

logger = logging.getLogger(__name__)


def render_set(rendered: RenderedSet, scratch: Path, out: Path, workers: int) -> None:
    """Render what is not yet in `scratch`, then link all shards into `out`.

    Run again after an interruption, it continues with the shards that are unfinished or have been
    cut short since; the result is byte-identical to an undisturbed run. Raises InputError if a
    worker fails, naming its log.
    """
    folder = scratch / rendered.fingerprint()
    folder.mkdir(parents=True, exist_ok=True)
    shards = rendered.shards(folder)
    missing = [shard for shard in shards if not _is_finished(shard)]
    logger.info("%d of %d shards are to be rendered in %s", len(missing), len(shards), folder)
    _render(rendered, missing, workers)
    link_shards(shards, out)


def _is_finished(shard: Shard) -> bool:
    """Whether a shard can be used as it is. A shard in `out` is the same file under another name:
    whoever cuts that one short has cut this one."""
    if not shard.path.exists():
        return False
    whole = is_whole(shard.path)
    if not whole:
        logger.warning("%s is truncated or damaged: rendering it again", shard.path)
    return whole


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
    log = shard.path.with_suffix(".log")
    # The job's file is this run's own: another run of the same set may have the same shards to do.
    with tempfile.NamedTemporaryFile("w", suffix=".json") as job_file:
        job_file.write(to_json(_job(rendered, shard)))
        job_file.flush()
        command = _command(Path(job_file.name), log)
        process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        processes.append(process)
        complaint = _follow(process, bar)
    if process.returncode != 0:
        raise InputError(complaint or f"rendering {shard.path.name} failed; see {log}")


def _follow(process: subprocess.Popen[str], bar: Any) -> str:
    """Count a worker's finished images until it ends; returns its complaint, if it had one."""
    complaint = ""
    for line in process.stdout or ():
        if line.strip() == IMAGE_DONE:
            bar.update()
        else:
            complaint = line.strip().removeprefix("error: ")
    process.wait()
    return complaint


def _command(job_file: Path, log: Path) -> list[str]:
    return [sys.executable, "-m", "shaftpose.rendering.worker", str(job_file), str(log)]


def _job(rendered: RenderedSet, shard: Shard) -> Job:
    return Job(
        settings=rendered.settings,
        backgrounds=dict(rendered.backgrounds),
        seed=rendered.seed,
        first=shard.first,
        count=shard.count,
        path=shard.path,
    )
