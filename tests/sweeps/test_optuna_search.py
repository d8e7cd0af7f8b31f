"""The search of a sweep's settings with Optuna."""

import math
from pathlib import Path
from types import SimpleNamespace

import mlflow
import pytest
from hydra.core.override_parser.overrides_parser import OverridesParser
from omegaconf import OmegaConf
from optuna.distributions import CategoricalDistribution, FloatDistribution, IntDistribution

from hydra_plugins.optuna_search import OptunaSearch, distribution, objectives, overrides
from shaftpose.tracking.sweeps import start_sweep
from shaftpose.tracking.trainings import training_run

GIVEN = ["variant=d", "loss.alpha=interval(0.5,5.0)", "loss.gamma=tag(log,interval(1.0,25.0))"]


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ("a=interval(0.5,5.0)", FloatDistribution(0.5, 5.0)),
        ("a=tag(log,interval(0.5,5.0))", FloatDistribution(0.5, 5.0, log=True)),
        ("a=int(interval(1,5))", IntDistribution(1, 5)),
        ("a=[1,2],[2,2]", CategoricalDistribution(["[1,2]", "[2,2]"])),
        ("a=range(1,4)", CategoricalDistribution(["1", "2", "3"])),
    ],
)
def test_a_swept_setting_has_a_distribution(given: str, expected: object) -> None:
    assert distribution(OverridesParser.create().parse_override(given)) == expected


def test_a_jobs_numbers_are_short() -> None:
    assert overrides({"a": 1.23456, "b": 3, "c": "[1,2]"}) == ["a=1.235", "b=3", "c=[1,2]"]


def test_a_job_is_known_by_its_overrides(store: Path) -> None:
    start_sweep(store, "trials", {})
    for n, known in enumerate(({"validation/mAP": 0.9, "validation/tip_mm": 4.0}, {})):
        with training_run(f"{n}", "d", {"n": n}, {}, "data/render", store, [f"n={n}"]):
            mlflow.log_metrics({"validation/mAP": 0.0} | known, step=2)
    with pytest.raises(RuntimeError), training_run("2", "d", {}, {}, "", store, ["n=2"]):
        raise RuntimeError
    assert objectives(store, ["n=0"]) == (0.9, 4.0)
    assert objectives(store, ["n=1"]) == (0.0, math.inf)
    assert objectives(store, ["n=2"]) is None


class Launcher:
    """Notes jobs, of which some fail, and answers for `objectives` with their alpha and gamma."""

    def __init__(self, failing: tuple[int, ...] = ()) -> None:
        self.jobs: list[list[str]] = []
        self.batches: list[tuple[int, int]] = []
        self.failing = failing

    def launch(self, batch: list[list[str]], initial_job_idx: int) -> list[SimpleNamespace]:
        self.batches.append((initial_job_idx, len(batch)))
        self.jobs += batch
        return [SimpleNamespace(overrides=job, return_value=None) for job in batch]

    def objectives(self, folder: Path, given: list[str]) -> tuple[float, float] | None:
        if self.jobs.index(given) in self.failing:
            return None
        alpha, gamma = (float(one.partition("=")[2]) for one in given[1:])
        return 1 - abs(alpha - 2) / 5, abs(gamma - 5)


def searched(
    monkeypatch: pytest.MonkeyPatch, trials: int, at_once: int, failing: tuple[int, ...] = ()
) -> Launcher:
    """The launcher of a search, after it."""
    search, launcher = OptunaSearch(trials, at_once), Launcher(failing)
    search.config = OmegaConf.create({"seed": 7, "hydra": {"sweep": {"dir": "sweeps/mine"}}})
    search.parser, search.launcher = OverridesParser.create(), launcher
    # Not by the module's name: Hydra's search for plugins may have loaded it once more.
    monkeypatch.setitem(OptunaSearch.sweep.__globals__, "objectives", launcher.objectives)
    search.sweep(GIVEN)
    return launcher


def test_a_search_asks_for_as_many_jobs_at_once_as_are_run(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    assert searched(monkeypatch, trials=5, at_once=2).batches == [(0, 2), (2, 2), (4, 1)]


def test_a_search_that_is_started_again_repeats_its_jobs(monkeypatch: pytest.MonkeyPatch) -> None:
    first = searched(monkeypatch, trials=14, at_once=1, failing=(3,)).jobs
    assert searched(monkeypatch, trials=16, at_once=1, failing=(3,)).jobs[:14] == first
    assert all(job[0] == "variant=d" for job in first)


def test_a_search_learns_from_its_jobs(monkeypatch: pytest.MonkeyPatch) -> None:
    jobs = searched(monkeypatch, trials=30, at_once=1).jobs
    alphas = [float(job[1].partition("=")[2]) for job in jobs]
    assert sum(abs(alpha - 2) for alpha in alphas[20:]) < sum(abs(a - 2) for a in alphas[:10])
