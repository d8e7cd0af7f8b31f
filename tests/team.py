"""Two machines and an MLflow server with a database in PostgreSQL, for `tests/test_services.py`.

`pg_virtualenv` runs this next to a PostgreSQL server of its own, whose address it exports. Its
arguments:
a model, and a folder for the server.
"""

import os
import sys
from pathlib import Path

import mlflow
import numpy as np

from shaftpose.tracking.connection import connect
from shaftpose.tracking.models import log_model, registered_model
from shaftpose.tracking.trainings import log_results, training_run
from tests.servers import BIN, free_port, server
from tests.tracking.registering import register


def main(model: Path, folder: Path) -> None:
    port, env = free_port(), os.environ
    database = f"{env['PGUSER']}:{env['PGPASSWORD']}@127.0.0.1:{env['PGPORT']}/postgres"
    command = [
        str(BIN / "mlflow"), "server", "--backend-store-uri", f"postgresql+psycopg2://{database}",
        "--artifacts-destination", str(folder / "artifacts"), "--host", "127.0.0.1",
        "--port", str(port), "--workers", "1",
    ]  # fmt: skip
    with server(command, port, folder / "server.log"):
        work(f"http://127.0.0.1:{port}", model, folder)


def work(uri: str, model: Path, folder: Path) -> None:
    """One machine tracks a training and registers its model, another one loads it."""
    first, second = folder / "first", folder / "second"
    for machine in (first, second):
        machine.mkdir()
    os.chdir(first)
    connect(uri, "trials")
    with training_run("id-1", "d", {"alpha": 1.5}, {"data/render": "aa"}, "data/render", first):
        mlflow.log_metric("train/loss", 3.0)
    log_results("id-1", "d", {"mAP": 0.5}, {})
    log_model("id-1", "d", model, np.zeros((1, 299, 299, 3), dtype=np.uint8))
    register("id-1")
    os.chdir(second)
    os.environ["MLFLOW_TRACKING_URI"] = uri
    (run,) = mlflow.search_runs(experiment_names=["trials"], output_format="list")
    assert run.data.metrics["mAP"] == 0.5 and run.data.params["alpha"] == "1.5"
    with registered_model("shaftpose@champion") as path:
        assert path.stat().st_size > 0
    assert not list(first.rglob("*.onnx"))
    assert list((folder / "artifacts").rglob("model.onnx"))


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
