"""A training on a machine that has torch and Lightning, but neither Hydra nor MLflow.

`python -m shaftpose.training.bare OUT`, in a folder that `tools/pack_training.py` has filled,
trains, or resumes, and writes the result to OUT, for `tools/unpack_training.py`: the files of a
training, the checkpoint in pieces, and `run.json` for MLflow.
"""

import argparse
import logging
import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from lightning.pytorch.loggers import Logger
from lightning.pytorch.loggers.logger import DummyLogger

from shaftpose.core.errors import exit_on_input_error
from shaftpose.core.files import write_json
from shaftpose.settings.tree import Settings
from shaftpose.stage_files import read_stage_file
from shaftpose.training.data import DataFolders
from shaftpose.training.pieces import write_checkpoint_pieces
from shaftpose.training.recipe import training_recipe
from shaftpose.training.run import CHECKPOINT, CURVES, RECORD, train

# In the folder of a packed training.
SETTINGS, DETECTOR = Path("settings.json"), Path("detector/model.ckpt")
FOLDERS = DataFolders(Path("images"), Path("split"), Path("mixed_in"))
_SCRATCH, _WHOLE = Path("scratch"), Path("result")
RUN = "run.json"


@dataclass(frozen=True)
class NotedRun:
    """What MLflow is told of a training at its start; see `training.run.OpenTrackedRun`."""

    training_id: str
    parameters: Mapping[str, Any]
    digests: Mapping[str, str]


def main() -> None:
    """Train, or resume."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("out", type=Path, help="folder for the result")
    logging.basicConfig(level=logging.INFO, format="%(message)s")
    with exit_on_input_error():
        train_packed(parser.parse_args().out)


def train_packed(out: Path) -> None:
    """Run the training in the working directory, and write its result to a folder."""
    settings = read_stage_file(SETTINGS, Settings, "pack the training again")
    train(training_recipe(settings), FOLDERS, _SCRATCH, _WHOLE, settings.profile, noted_run)
    out.mkdir(parents=True, exist_ok=True)
    for name in (CURVES, RECORD, RUN):
        shutil.copyfile(_WHOLE / name, out / name)
    write_checkpoint_pieces(_WHOLE / CHECKPOINT, out)


@contextmanager
def noted_run(
    training_id: str, parameters: dict[str, Any], digests: dict[str, str]
) -> Iterator[Logger]:
    """Note a run in a file. The curves already hold all that Lightning logs to it."""
    write_json(_WHOLE / RUN, asdict(NotedRun(training_id, parameters, digests)))
    yield DummyLogger()


if __name__ == "__main__":
    main()
