"""Stage `train`: trains one variant; writes a checkpoint and learning curves."""

from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

from lightning.pytorch.loggers import Logger

from shaftpose.settings.stage import stage
from shaftpose.settings.tree import Settings
from shaftpose.tracking.connection import connect
from shaftpose.tracking.dvc_lock import locked_hashes
from shaftpose.tracking.trainings import training_run
from shaftpose.training.data import DataFolders
from shaftpose.training.recipe import training_recipe
from shaftpose.training.run import train

FOLDERS = DataFolders(Path("data/render/images"), Path("data/split"), Path("data/real"))


@stage
def main(settings: Settings) -> None:
    """Write `model.ckpt`, `curves.csv` and `training.json` to `out`."""

    def open_tracked_run(
        training_id: str, parameters: dict[str, Any], digests: dict[str, str]
    ) -> AbstractContextManager[Logger]:
        connect(settings.tracking.uri, settings.tracking.experiment)
        dataset = locked_hashes(Path("dvc.lock"), Path("data")) | digests
        return training_run(
            training_id, settings.variant.name, parameters, dataset, "data/render",
            settings.out.parent, settings.overrides, settings,
        )  # fmt: skip

    recipe, scratch = training_recipe(settings), Path("data/scratch")
    train(recipe, FOLDERS, scratch, settings.out, settings.profile, open_tracked_run)


if __name__ == "__main__":
    main()
