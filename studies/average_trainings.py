"""Average the weights of a training with those of the training that it started from.

`python -m studies.average_trainings models/operations models/steel --out models/e_real`: a network
that goes on learning from other images forgets some of what it knew; half way between its weights
before and after, it keeps most of both (Wortsman et al., Robust Fine-Tuning of Zero-Shot Models,
CVPR 2022). E's edge reader, a network of its own, is that of the later training: its mean is less
exact. The result is the folder of a training, to be exported and evaluated like any other.
"""

import argparse
import hashlib
import json
import shutil
from collections.abc import Mapping
from dataclasses import asdict, replace
from pathlib import Path

import torch
from torch import Tensor

from shaftpose.core.errors import InputError, exit_on_input_error
from shaftpose.core.files import new_file, write_json
from shaftpose.network.checkpoint import WEIGHT_PREFIX, identity_of
from shaftpose.stage_files import TrainingRecord
from shaftpose.training.fingerprint import start_digest
from shaftpose.training.run import CHECKPOINT, CURVES, RECORD
from studies.evaluate_trainings import finished

EDGES = f"{WEIGHT_PREFIX}edges."


def main() -> None:
    """Average the trainings of the command line."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("before", type=Path, help="folder of a finished training")
    parser.add_argument("after", type=Path, help="folder of one that started from its weights")
    parser.add_argument("--out", type=Path, required=True, help="folder of the average")
    parser.add_argument("--share", type=float, default=0.5, help="weight of `after` (0.5)")
    arguments = parser.parse_args()
    with exit_on_input_error():
        average(arguments.before, arguments.after, arguments.out, arguments.share)
        print(f"the average is in {arguments.out}")


def average(before: Path, after: Path, out: Path, share: float = 0.5) -> None:
    """Write the average as checkpoint, curves and record of `after`, to `out`.

    Raises InputError if `share` is not between 0 and 1, `out` is one of both, or `after` did not
    start from the same network in `before`: the mean of trainings without a common start does not
    work.
    """
    if not 0 < share < 1:
        raise InputError(f"--share {share}: give a number between 0 and 1, both left out")
    if out.resolve() in (before.resolve(), after.resolve()):
        raise InputError(f"--out {out}: holds one of both trainings; name another folder")
    paths = before / CHECKPOINT, after / CHECKPOINT
    same = identity_of(paths[0]) == identity_of(paths[1])
    records = finished(before), finished(after)
    if not same or records[1].data.start != start_digest(paths[0]):
        raise InputError(
            f"{after}: did not start from the same network in {paths[0]}; name the one it did"
        )
    old, new = (torch.load(path, map_location="cpu", weights_only=True) for path in paths)
    weights = mean(old["state_dict"], new["state_dict"], share)
    out.mkdir(parents=True, exist_ok=True)
    with new_file(out / CHECKPOINT) as part:
        torch.save({**new, "state_dict": weights}, part)
    with new_file(out / CURVES) as part:
        shutil.copyfile(after / CURVES, part)
    write_json(out / RECORD, asdict(of_average(*records, share)))


def mean(old: Mapping[str, Tensor], new: Mapping[str, Tensor], share: float) -> dict[str, Tensor]:
    """The mean of weights and statistics, `share` of it from `new`; an edge reader and counters are
    those of `new`."""
    return {
        name: value
        if name.startswith(EDGES) or not value.is_floating_point()
        else old[name].lerp(value, share)
        for name, value in new.items()
    }


def of_average(before: TrainingRecord, after: TrainingRecord, share: float) -> TrainingRecord:
    """The record of the average: that of `after` with an id of its own, and the share."""
    origin = json.dumps([before.training_id, after.training_id, share])
    return replace(
        after,
        training_id=hashlib.sha256(origin.encode()).hexdigest()[:32],
        variant={**after.variant, "average_share": share},
    )


if __name__ == "__main__":
    main()
