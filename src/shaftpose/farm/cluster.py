"""Dask clusters that render shards: on this machine, at a running scheduler, or in Slurm jobs.

A local cluster listens only on 127.0.0.1; with Slurm, scheduler and workers communicate over the
network, encrypted with their own keys.
"""

import logging
import signal
import subprocess
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import dask.config
from distributed import Client, LocalCluster

from shaftpose.errors import InputError
from shaftpose.settings.parts import ClusterSettings, SlurmSettings

if TYPE_CHECKING:
    from dask_jobqueue import SLURMCluster

logger = logging.getLogger(__name__)

# Python source that Dask runs in each worker process. Ctrl-C reaches all processes of a terminal:
# the one that started the run ends the others in order.
_LEAVE_INTERRUPTS_ALONE = "import signal; signal.signal(signal.SIGINT, signal.SIG_IGN)"
# Address of Dask's health pages and, if bokeh is installed, its dashboard.
_PAGES = "127.0.0.1:0"
_ANSWER_S = 30.0
# Settings of a Slurm site that are extended, or replaced only if unset.
_SITE = ("shared-temp-directory", "log-directory", "scheduler-options", "worker-extra-args")
_JOB_LOGS = "outputs/slurm"


@contextmanager
def connect(settings: ClusterSettings) -> Iterator[Client]:
    """A client of the settings' workers; workers started for it end with it.

    Raises InputError if the scheduler does not answer or Slurm is missing.
    """
    with ExitStack() as stack:
        if settings.address is not None:
            client = _client_of(settings.address)
        elif settings.slurm is not None:
            cluster = stack.enter_context(slurm_cluster(settings.slurm))
            _submit_jobs(cluster, settings.slurm.jobs)
            client = Client(cluster, set_as_default=False)
        else:
            client = Client(stack.enter_context(_local(settings.workers)), set_as_default=False)
        yield stack.enter_context(client)


def _client_of(address: str) -> Client:
    try:
        client = Client(address, timeout=_ANSWER_S, set_as_default=False)
    except (OSError, ValueError) as error:
        raise InputError(
            f"cluster.address = {address}: no Dask scheduler answers there; start one, or set it "
            "to null to render on this machine"
        ) from error
    if not client.scheduler_info()["workers"]:
        logger.warning(
            "cluster.address = %s: the scheduler has no workers yet; nothing is rendered until "
            "`dask worker %s --nthreads 1 --memory-limit 0` runs somewhere", address, address,
        )  # fmt: skip
    return client


def _local(workers: int) -> LocalCluster:
    return LocalCluster(
        n_workers=workers,
        threads_per_worker=1,
        host="127.0.0.1",
        dashboard_address=_PAGES,
        worker_dashboard_address=None,
        memory_limit=None,  # of the Dask worker, without Blender's memory
        preload=[_LEAVE_INTERRUPTS_ALONE],
        silence_logs=logging.CRITICAL,  # tasks report problems themselves
    )


def slurm_cluster(settings: SlurmSettings) -> "SLURMCluster":
    """A scheduler for jobs with one worker per core; no job is submitted yet.

    Dask reads further site settings, such as account or network interface, from
    ~/.config/dask/jobqueue.yaml.
    """
    # Importing dask-jobqueue 0.9.0 makes Ctrl-C end the process with status 0 (its issue 696).
    on_interrupt = signal.getsignal(signal.SIGINT)
    from dask_jobqueue import SLURMCluster

    signal.signal(signal.SIGINT, on_interrupt)
    site = {key: dask.config.get(f"jobqueue.slurm.{key}") for key in _SITE}
    return SLURMCluster(
        queue=settings.queue,
        cores=settings.cores,
        processes=settings.cores,
        memory=settings.memory,
        walltime=settings.walltime,
        security=True,
        shared_temp_directory=site["shared-temp-directory"] or str(Path.home()),
        log_directory=site["log-directory"] or _JOB_LOGS,
        scheduler_options={**site["scheduler-options"], "dashboard_address": _PAGES},
        worker_extra_args=[*site["worker-extra-args"], "--dashboard-address", _PAGES],
    )


def _submit_jobs(cluster: "SLURMCluster", jobs: int) -> None:
    """Submit jobs, and replace those whose time runs out. First asks Slurm whether it accepts
    them, because Dask would wait for a refused job."""
    test = ["sbatch", "--test-only"]
    try:
        asked = subprocess.run(test, input=cluster.job_script(), capture_output=True, text=True)
    except FileNotFoundError as error:
        raise InputError(
            "cluster.slurm: sbatch is missing here; run on a machine that submits Slurm jobs, or "
            "set it to null"
        ) from error
    if asked.returncode:
        answer = " ".join(asked.stderr.split())
        raise InputError(f"cluster.slurm: Slurm refuses such jobs: {answer}; correct the settings")
    cluster.adapt(minimum_jobs=jobs, maximum_jobs=jobs)
