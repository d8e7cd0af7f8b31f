"""Pack a training for a machine that lacks this environment (docs/training.md).

`python -m tools.pack_training FOLDER variant=d_noise profile=bench ...` writes its settings, code
and data to FOLDER in pieces, with the script that trains there. `tools/unpack_training.py` takes
the result.
"""

import argparse
import shutil
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

from pipelines.train import FOLDERS
from shaftpose.core.errors import InputError, exit_on_input_error
from shaftpose.core.shard_index import shard_paths
from shaftpose.dataset.split import PARTS
from shaftpose.network.building import initial_network
from shaftpose.settings.compose import composed_settings
from shaftpose.settings.parsing import to_json
from shaftpose.settings.tree import Settings
from shaftpose.training import bare
from shaftpose.training.pieces import write_pieces
from shaftpose.training.recipe import training_recipe

ROOT = Path(__file__).parents[1]


def main() -> None:
    """Pack the training of the command line."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("folder", type=Path, help="for the pieces")
    parser.add_argument("settings", nargs="*", help="Hydra's overrides")
    parser.add_argument("--wheels", type=Path, help="folder of wheels to be installed there")
    parser.add_argument("--piece-mib", type=int, default=40, help="size of a piece (40)")
    arguments = parser.parse_intermixed_args()
    with exit_on_input_error():
        if arguments.piece_mib < 1:
            raise InputError(f"--piece-mib {arguments.piece_mib}: give a number above 0")
        if arguments.wheels is not None and not arguments.wheels.is_dir():
            raise InputError(f"--wheels {arguments.wheels}: no folder; name one with wheels")
        settings = composed_settings(ROOT, *arguments.settings)
        pack(settings, arguments.folder, arguments.wheels, arguments.piece_mib * 2**20)


def pack(settings: Settings, folder: Path, wheels: Path | None, most_bytes: int) -> None:
    """Write the pieces of a training, and the script, to a folder.

    wheels: folder of packages that the other machine lacks. Raises as `write_files` does.
    """
    with TemporaryDirectory() as scratch:
        inside = Path(scratch) / "pack"
        write_files(settings, inside)
        if wheels is not None:
            shutil.copytree(wheels, inside / "wheels")
        archive = shutil.make_archive(f"{scratch}/pack", "gztar", root_dir=inside)
        write_pieces(Path(archive), folder, most_bytes)
    shutil.copy(Path(__file__).parent / "train_packed.sh", folder)


def write_files(settings: Settings, folder: Path) -> None:
    """Write settings, code and data of a training to a folder.

    Raises InputError if data are missing, or the detector does not fit the network.
    """
    initial_network(training_recipe(settings).variant)  # does its detector fit?
    package = ROOT / "src/shaftpose"
    for path in package.rglob("*.py"):
        copy(path, folder / path.relative_to(package.parent))
    for path in shard_paths(FOLDERS.rendered):
        copy(path, folder / bare.FOLDERS.rendered / path.name)
    for part in PARTS:
        copy(FOLDERS.split / f"{part}.csv", folder / bare.FOLDERS.split / f"{part}.csv")
    variant = settings.variant
    if variant.real_share > 0:
        files = [image.path for image in FOLDERS.mixed_in_images()]
        for path in (*files, *(FOLDERS.mixed_in / name for name in ("train.json", "about.json"))):
            copy(path, folder / bare.FOLDERS.mixed_in / path.relative_to(FOLDERS.mixed_in))
    if variant.start is not None:
        copy(variant.start, folder / bare.DETECTOR)
        variant = replace(variant, start=bare.DETECTOR)
    (folder / bare.SETTINGS).write_text(to_json(replace(settings, variant=variant)))


def copy(path: Path, target: Path) -> None:
    """Copy a file. Raises InputError if it is missing."""
    if not path.is_file():
        raise InputError(f"{path}: missing; run the stages of `dvc repro` before `train`")
    target.parent.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(path, target)


if __name__ == "__main__":
    main()
