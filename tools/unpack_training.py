"""Take the result of a training that `tools/pack_training.py` has packed, and track it in MLflow.

`python -m tools.unpack_training FOLDER OUT`: FOLDER is where `train_packed.sh` has written, OUT
gets `model.ckpt`, `curves.csv` and `training.json`, as from `pipelines/train.py out=OUT`.
"""

import argparse
import shutil
from itertools import groupby
from pathlib import Path

from shaftpose.core.errors import exit_on_input_error
from shaftpose.core.files import new_file
from shaftpose.evaluation.model_results import read_curves
from shaftpose.network.checkpoint import identity_of
from shaftpose.settings.compose import composed_settings
from shaftpose.stage_files import read_stage_file
from shaftpose.tracking.connection import connect
from shaftpose.tracking.trainings import training_run
from shaftpose.training.bare import RUN, NotedRun
from shaftpose.training.pieces import join_checkpoint_pieces
from shaftpose.training.run import CHECKPOINT, CURVES, RECORD

ROOT = Path(__file__).parents[1]


def main() -> None:
    """Unpack the training of the command line."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("folder", type=Path, help="the result, with all pieces of the checkpoint")
    parser.add_argument("out", type=Path, help="for the files of the training")
    arguments = parser.parse_args()
    with exit_on_input_error():
        unpack(arguments.folder, arguments.out)
        tracking = composed_settings(ROOT).tracking
        connect(tracking.uri, tracking.experiment)
        track(arguments.folder, arguments.out)


def unpack(folder: Path, out: Path) -> None:
    """Write the files of a training. Raises InputError if pieces of its checkpoint are missing."""
    join_checkpoint_pieces(folder, out / CHECKPOINT)
    for name in (CURVES, RECORD):
        with new_file(out / name) as part:
            shutil.copyfile(folder / name, part)


def track(folder: Path, out: Path) -> None:
    """Log an unpacked training to MLflow as its own run."""
    run = read_stage_file(folder / RUN, NotedRun, "copy the result again")
    name = str(identity_of(out / CHECKPOINT)["variant"])
    rows = read_curves(out / CURVES)
    with training_run(
        run.training_id, name, run.parameters, run.digests, "data/render", out.parent
    ) as logger:
        for step, points in groupby(rows, key=lambda row: row[0]):
            logger.log_metrics({metric: value for _, metric, value in points}, step)


if __name__ == "__main__":
    main()
