"""Dask workers: processes of this machine, for this run alone, or those of a running scheduler."""

import logging
from collections.abc import Iterator
from concurrent.futures import CancelledError
from contextlib import ExitStack, contextmanager
from importlib.metadata import version

from distributed import Client, LocalCluster
from distributed.client import ClosedClientError

from shaftpose.core.errors import InputError

logger = logging.getLogger(__name__)

# Address of Dask's health pages and, if bokeh is installed, its dashboard.
PAGES = "127.0.0.1:0"
# Python source that Dask runs in each worker process. Ctrl-C reaches all processes of a terminal,
# but the process that started the run must end the others in order.
_LEAVE_INTERRUPTS_ALONE = "import signal; signal.signal(signal.SIGINT, signal.SIG_IGN)"
_ANSWER_S = 30.0


@contextmanager
def client_of(workers: int | str, *packages: str) -> Iterator[Client]:
    """A Dask client of new processes of this machine or of a running scheduler.

    workers: the number of processes, which end with the block, or the scheduler's address.
    packages: that its workers need, besides shaftpose. Raises InputError if the scheduler does not
    answer or one of its workers lacks a package.
    """
    with ExitStack() as stack:
        if isinstance(workers, str):
            client = stack.enter_context(_client_at(workers))
            _check_workers(client, "shaftpose", *packages)
        else:
            cluster = stack.enter_context(_local(workers))
            client = stack.enter_context(Client(cluster, set_as_default=False))
        yield client


@contextmanager
def naming_lost_scheduler(remedy: str) -> Iterator[None]:
    """Turn errors of the scheduler inside the block into an InputError with this remedy.

    The connection may be lost, or the scheduler unable to import a task.
    """
    try:
        yield
    except (CancelledError, ClosedClientError) as error:
        raise InputError(f"the connection to the Dask scheduler is lost; {remedy}") from error
    except RuntimeError as error:
        if not isinstance(error.__cause__, ImportError | AttributeError):
            raise
        raise InputError(
            f"the Dask scheduler cannot import a task ({error.__cause__}); install the same "
            f"versions on its machine as here; {remedy}"
        ) from error


def _client_at(address: str) -> Client:
    try:
        client = Client(address, timeout=_ANSWER_S, set_as_default=False)
    except (OSError, ValueError) as error:
        raise InputError(
            f"{address}: no Dask scheduler answers there; start one, or give a number of workers "
            "instead, for processes of this machine"
        ) from error
    if not client.scheduler_info()["workers"]:
        logger.warning(
            "%s: the scheduler has no workers yet; nothing happens until "
            "`dask worker %s --nthreads 1 --memory-limit 0` runs somewhere", address, address,
        )  # fmt: skip
    return client


def _check_workers(client: Client, *packages: str) -> None:
    """Raise InputError if a worker lacks a package.

    A worker that cannot import a task dies of it, and Dask waits for others forever.
    """
    for package in packages:
        answers = client.run(version, package, on_error="return")
        without = [worker for worker, answer in answers.items() if isinstance(answer, Exception)]
        if without:
            raise InputError(
                f"{without[0]}: no {package} on this Dask worker ({len(without)} of "
                f"{len(answers)}); start workers from an environment with the same versions as here"
            )


def _local(workers: int) -> LocalCluster:
    return LocalCluster(
        n_workers=workers,
        threads_per_worker=1,
        host="127.0.0.1",
        security=True,  # needs this run's keys: else any local account could connect
        dashboard_address=PAGES,
        worker_dashboard_address=None,
        memory_limit=None,  # of the Dask worker, without Blender's memory
        preload=[_LEAVE_INTERRUPTS_ALONE],
        silence_logs=logging.CRITICAL,  # tasks report problems themselves
    )
