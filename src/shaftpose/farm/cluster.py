"""Dask clusters that render shards: on this machine, at a running scheduler, or in Slurm jobs.

With Slurm, scheduler and workers communicate over the network, encrypted with their own keys.
"""

import logging
import signal
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import dask.config
from distributed import Client

from shaftpose.core.errors import InputError
from shaftpose.farm.workers import PAGES, client_of
from shaftpose.settings.schema import ClusterSettings, SlurmSettings

if TYPE_CHECKING:
    from dask_jobqueue import SLURMCluster

logger = logging.getLogger(__name__)

# The site's settings of dask-jobqueue that are extended, or overridden only if unset.
_SITE = ("shared-temp-directory", "log-directory", "scheduler-options", "worker-extra-args")
_JOB_LOGS = "outputs/slurm"


@contextmanager
def cluster_client(settings: ClusterSettings) -> Iterator[Client]:
    """A Dask client of the workers that the settings describe; those it starts end with the block.

    Raises InputError if the scheduler does not answer, one of its workers lacks a package that
    renders, or Slurm is missing or refuses the jobs.
    """
    if settings.slurm is None:
        with client_of(settings.address or settings.workers, "bpy", "trimesh") as client:
            yield client
    else:
        with slurm_cluster(settings.slurm) as cluster:
            _submit_jobs(cluster, settings.slurm.jobs)
            logger.info(
                "rendering begins with the first Slurm job (squeue lists them). If jobs run but "
                "render nothing, they cannot reach this machine: see their logs, and set "
                "`interface` in ~/.config/dask/jobqueue.yaml"
            )
            with Client(cluster, set_as_default=False) as client:
                yield client


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
        scheduler_options={**site["scheduler-options"], "dashboard_address": PAGES},
        worker_extra_args=[*site["worker-extra-args"], "--dashboard-address", PAGES],
    )


def _submit_jobs(cluster: "SLURMCluster", jobs: int) -> None:
    """Submit jobs; those whose time runs out are replaced.

    Raises InputError if Slurm would refuse them: Dask would wait for a refused job forever.
    """
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
