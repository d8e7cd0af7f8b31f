"""Any number of tasks on Dask workers, with their results in the order of the tasks."""

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from typing import TypeVar

from distributed import Client, Future, KilledWorker

from shaftpose.farm.workers import naming_lost_scheduler

Task = TypeVar("Task")
Result = TypeVar("Result")

# Most tasks that are submitted and not yet returned: limits memory, however many tasks there are.
_UNDER_WAY = 1000


def in_order(
    client: Client, work: Callable[[Task], Result], tasks: Iterable[Task]
) -> Iterator[tuple[Task, Result | None]]:
    """Yield each task with its result of `work`, in the order of the tasks.

    Finished results are yielded when another task arrives, and after the last one: while `tasks`
    blocks, they wait.

    A task whose worker dies is repeated. Its result is None once four workers that held it have
    died, even of other tasks. Raises InputError if the connection to the scheduler is lost or the
    scheduler cannot import a task; exceptions of `work` are passed on.
    """
    remedy = "finished results are kept: repeat the command, if possible with --resume"
    with naming_lost_scheduler(remedy):
        yield from _results(client, work, tasks)


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
    """Remove the first task and wait for its result."""
    task, future = under_way.popleft()
    try:
        return task, future.result()
    except KilledWorker:
        return task, None
