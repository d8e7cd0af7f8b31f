"""Tasks on real worker processes: results in order, whatever happens to workers."""

import os
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from distributed import Client, LocalCluster

from shaftpose.core.errors import InputError
from shaftpose.farm import ordered_tasks
from shaftpose.farm.ordered_tasks import in_order
from shaftpose.farm.workers import client_of


@pytest.fixture(scope="module")
def client() -> Iterator[Client]:
    """Two workers."""
    with client_of(2) as client:
        yield client


def slept(seconds: float) -> int:
    """The process, after some time."""
    time.sleep(seconds)
    return os.getpid()


def die_until_there_are(deaths: tuple[Path, int]) -> str:
    """Leave a file in a folder and kill this process, unless it holds so many."""
    folder, count = deaths
    if len(list(folder.iterdir())) < count:
        (folder / str(os.getpid())).touch()
        os._exit(1)
    return "alive"


def refuse(reason: str) -> None:
    raise InputError(reason)


def test_results_have_the_order_of_the_tasks(client: Client) -> None:
    tasks = [0.3, 0.0, 0.1, 0.0, 0.0]
    results = list(in_order(client, slept, tasks))
    assert [task for task, _ in results] == tasks
    processes = {process for _, process in results}
    assert len(processes) == 2 and os.getpid() not in processes


def test_few_tasks_are_under_way_at_a_time(client: Client, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ordered_tasks, "_UNDER_WAY", 3)
    taken = []
    tasks = (taken.append(number) or 0.0 for number in range(50))  # type: ignore[func-returns-value]
    ahead = [len(taken) - given for given, _ in enumerate(in_order(client, slept, tasks))]
    assert len(ahead) == 50
    assert max(ahead) <= 3


def test_a_result_is_there_before_the_tasks_end(client: Client) -> None:
    def endless() -> Iterator[float]:
        while True:
            yield 0.0
            time.sleep(0.05)

    assert next(in_order(client, slept, endless()))[0] == 0.0


def test_a_task_whose_worker_dies_is_repeated(client: Client, tmp_path: Path) -> None:
    tasks = [(tmp_path, 1), (tmp_path, 0)]
    assert [result for _, result in in_order(client, die_until_there_are, tasks)] == ["alive"] * 2
    assert len(list(tmp_path.iterdir())) == 1


def test_a_task_that_kills_its_workers_is_given_up_and_the_rest_goes_on(
    client: Client, tmp_path: Path
) -> None:
    (given_up,) = in_order(client, die_until_there_are, [(tmp_path, 99)])
    assert given_up[1] is None
    assert len(list(tmp_path.iterdir())) == 4
    (other,) = in_order(client, die_until_there_are, [(tmp_path, 0)])
    assert other[1] == "alive"


def test_what_the_work_raises_is_raised_here(client: Client) -> None:
    with pytest.raises(InputError, match="^no such model$"):
        list(in_order(client, refuse, ["no such model"]))


class FromAbsentModule:
    """Cannot be unpickled, as in an environment without this package."""

    def __reduce__(self) -> tuple[Any, ...]:
        return __import__, ("absent_module",)


def test_a_scheduler_without_the_software_is_told_apart(client: Client) -> None:
    with pytest.raises(InputError, match="'absent_module'.; install the same versions"):
        list(in_order(client, str, [FromAbsentModule()]))


def broken(_: int) -> None:
    raise RuntimeError("broken")


def test_other_errors_of_the_work_stay_as_they_are(client: Client) -> None:
    with pytest.raises(RuntimeError, match="^broken$"):
        list(in_order(client, broken, [0]))


def test_a_lost_scheduler_is_named() -> None:
    with (
        LocalCluster(n_workers=0, host="127.0.0.1", dashboard_address=None) as idle,
        client_of(idle.scheduler_address) as client,
    ):
        client.timeout = 0.1

        def tasks() -> Iterator[float]:
            yield 0.0
            idle.close()
            yield 0.0

        with pytest.raises(InputError, match="scheduler is lost; .*repeat the command"):
            list(in_order(client, slept, tasks()))
