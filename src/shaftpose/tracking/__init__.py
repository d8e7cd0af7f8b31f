"""Experiment tracking; the only package that uses MLflow.

Each training has an id, stored next to its checkpoint and as a tag of its MLflow run. Later stages
find the run by this id, or create one if the database was not copied along with the models.
"""

import os

os.environ.setdefault("MLFLOW_DISABLE_TELEMETRY", "true")  # read when mlflow is imported
