"""Any number of tasks on Dask workers, with results in the tasks' order."""

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import CancelledError
from typing import TypeVar

from distributed import Client, Future, KilledWorker
from distributed.client import ClosedClientError

from shaftpose.errors import InputError

Task = TypeVar("Task")
Result = TypeVar("Result")

# Tasks that are submitted and not yet returned: memory does not grow with the number of all tasks.
_UNDER_WAY = 1000


def in_order(
    client: Client, work: Callable[[Task], Result], tasks: Iterable[Task]
) -> Iterator[tuple[Task, Result | None]]:
    """Each task with its result of `work`, in the order of the tasks.

    Finished results are given whenever another task comes, and after the last one: an iterator of
    tasks that blocks holds them back.
    A task whose worker dies is repeated; its result is None if four workers died that had it, even
    if they were at another task. Raises InputError if the connection to the scheduler is lost or it
    cannot import a task, and what `work` raises.
    """
    try:
        yield from _results(client, work, tasks)
    except (CancelledError, ClosedClientError) as error:
        raise InputError(
            "the connection to the Dask scheduler is lost; finished results are kept; run again "
            "with another --out"
        ) from error
    except RuntimeError as error:
        if not isinstance(error.__cause__, ImportError | AttributeError):
            raise
        raise InputError(
            f"the Dask scheduler cannot import a task ({error.__cause__}); install the same "
            "versions on its machine as here, then run again with another --out"
        ) from error


def _results(
    client: Client, work: Callable[[Task], Result], tasks: Iterable[Task]
) -> Iterator[tuple[Task, Result | None]]:
    under_way: deque[tuple[Task, Future]] = deque()
    for task in tasks:
        under_way.append((task, client.submit(work, task, pure=False)))
        while under_way and (under_way[0][1].done() or len(under_way) == _UNDER_WAY):
            yield _first(under_way)
    while under_way:
        yield _first(under_way)


def _first(under_way: deque[tuple[Task, Future]]) -> tuple[Task, Result | None]:
    """Take the first task, and wait for its result."""
    task, future = under_way.popleft()
    try:
        return task, future.result()
    except KilledWorker:
        return task, None
