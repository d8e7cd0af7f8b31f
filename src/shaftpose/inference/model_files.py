"""The model that `--model` names."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from shaftpose.core.errors import InputError
from shaftpose.inference.bundled import DEFAULT, bundled_model, bundled_names

REGISTRY = "mlflow:/"  # the beginning of a name in a model registry


@contextmanager
def model_file(name: str | None) -> Iterator[Path]:
    """The ONNX file of a model, as long as the block lasts.

    name: of a bundled model; a path; `mlflow:/NAME@ALIAS` or `mlflow:/NAME/VERSION` of a model
    registry; None for the default bundled model. A path is not checked. Raises InputError if a
    registry's model cannot be had.
    """
    if name is None or name in bundled_names():
        yield bundled_model(name or DEFAULT)
    elif name.startswith(REGISTRY):
        try:
            from shaftpose.tracking.models import registered_model
        except ImportError as error:
            raise InputError(
                f"{name}: needs MLflow: in a clone, pip install '.[pipeline]'"
            ) from error
        with registered_model(name.removeprefix(REGISTRY)) as path:
            yield path
    else:
        yield Path(name)
