"""Hydra's sweeper that searches with Optuna. Hydra takes sweepers from this package alone."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import Override
from hydra.core.plugins import Plugins
from hydra.core.utils import JobReturn
from hydra.plugins.sweeper import Sweeper
from hydra.types import HydraContext, TaskFunction
from omegaconf import DictConfig

if TYPE_CHECKING:
    from optuna.distributions import BaseDistribution


class OptunaSearch(Sweeper):
    """Trains the jobs that Optuna asks for, and tells it how their results were validated.

    trials: the number of jobs; at_once: jobs that it asks for together, as the launcher runs them.
    The same results lead to the same questions: a search that is started again skips its finished
    jobs, as a grid does.
    """

    def __init__(self, trials: int, at_once: int) -> None:
        self.trials, self.at_once = trials, at_once

    def setup(
        self, *, hydra_context: HydraContext, task_function: TaskFunction, config: DictConfig
    ) -> None:
        """Take Hydra's configuration and launcher."""
        self.config = config
        self.parser = OverridesParser.create(hydra_context.config_loader)
        self.launcher = Plugins.instance().instantiate_launcher(
            hydra_context=hydra_context, task_function=task_function, config=config
        )

    def sweep(self, arguments: list[str]) -> None:
        """Run the search; raises the first error of a job after the last one."""
        import optuna  # of the extra `sweep`; slow to import, and only a search needs it

        optuna.logging.set_verbosity(optuna.logging.WARNING)
        given = self.parser.parse_overrides(arguments)
        fixed = [one.input_line for one in given if not one.is_sweep_override()]
        space = {o.get_key_element(): distribution(o) for o in given if o.is_sweep_override()}
        sampler = optuna.samplers.TPESampler(seed=self.config.seed)
        study = optuna.create_study(sampler=sampler, directions=["maximize", "minimize"])
        done: list[JobReturn] = []
        while len(done) < self.trials:
            count = min(self.at_once, self.trials - len(done))
            trials = [study.ask(space) for _ in range(count)]
            batch = [[*fixed, *overrides(trial.params)] for trial in trials]
            done += self.launcher.launch(batch, initial_job_idx=len(done))
            for trial, job in zip(trials, done[-count:], strict=True):
                values = objectives(Path(self.config.hydra.sweep.dir).resolve(), job.overrides)
                study.tell(trial, values, state=None if values else optuna.trial.TrialState.FAIL)
        for job in done:
            _ = job.return_value  # raises what the job raised


def distribution(override: Override) -> "BaseDistribution":
    """The values of a swept setting: an interval, of integers if its ends are, or choices."""
    from optuna import distributions

    if not override.is_interval_sweep():
        return distributions.CategoricalDistribution(list(override.sweep_string_iterator()))
    sweep = override.value()
    whole = isinstance(sweep.start, int) and isinstance(sweep.end, int)
    kind = distributions.IntDistribution if whole else distributions.FloatDistribution
    return kind(sweep.start, sweep.end, log="log" in sweep.tags)


def overrides(parameters: Mapping[str, float | str]) -> list[str]:
    """A job's settings as on a command line, with numbers short enough for names of runs."""
    return [
        f"{key}={value:.4g}" if isinstance(value, float) else f"{key}={value}"
        for key, value in parameters.items()
    ]


def objectives(folder: Path, given: Sequence[str]) -> tuple[float, float] | None:
    """The mAP and `tip_mm` of a sweep's job, by its overrides; None if it did not finish.

    The tip error is infinite where nothing was detected.
    """
    from shaftpose.tracking.sweeps import sweep_runs  # MLflow is slow to import

    for run in sweep_runs(folder):
        if run.finished and list(run.overrides) == list(given):
            return run.metrics["validation/mAP"], run.metrics.get("validation/tip_mm", math.inf)
    return None
