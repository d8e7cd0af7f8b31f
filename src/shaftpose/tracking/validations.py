"""The validation of the weights that a training keeps, in its MLflow run."""

import mlflow
from mlflow.entities import Run


def validation_of_result(run: Run) -> tuple[int, dict[str, float]]:
    """The steps of a run up to the validation of its result, and the metrics of that validation:
    with `keep_best` the first one of the best mAP, else the last one.

    A metric's own last value may be older: pose errors are missing if nothing was found.
    """
    client = mlflow.MlflowClient()
    names = [name for name in run.data.metrics if name.startswith("validation/")]
    logged = [point for n in names for point in client.get_metric_history(run.info.run_id, n)]
    merits = [(point.value, -point.step) for point in logged if point.key == "validation/mAP"]
    if merits and _keeps_best(run):
        step = -max(merits)[1]
    else:
        step = max((point.step for point in logged), default=-1)  # counted from 0
    return step + 1, {point.key: point.value for point in logged if point.step == step}


def repeat_kept_validation(run_id: str) -> None:
    """Log the best validation of a training with `keep_best` once more, at its last step.

    MLflow's tables show each metric's last value, which then is that of the kept weights; one that
    this validation lacks, such as an error if nothing was found, keeps its own last value.
    """
    client = mlflow.MlflowClient()
    run = client.get_run(run_id)
    if _keeps_best(run):
        history = client.get_metric_history(run_id, "validation/mAP")
        last = max((point.step for point in history), default=0)
        mlflow.log_metrics(validation_of_result(run)[1], step=last, run_id=run_id)


def _keeps_best(run: Run) -> bool:
    return bool(run.data.params.get("training.keep_best") == "True")
