"""The hashes of the data, as `dvc.lock` states them."""

import logging
import time
from pathlib import Path
from typing import Any

import yaml

logger = logging.getLogger(__name__)

_TRIES = 5


def locked_hashes(lock: Path, folder: Path) -> dict[str, str]:
    """Path -> DVC's hash of every output below `folder`, as the file `lock` (`dvc.lock`) states it.

    Outputs of stages with variants are left out.
    """
    stages = _locked_stages(lock)
    outs = [out for name, entry in stages.items() if "@" not in name for out in entry["outs"]]
    return {out["path"]: out["md5"] for out in outs if folder in Path(out["path"]).parents}


def _locked_stages(lock: Path) -> dict[str, Any]:
    """The stages in `dvc.lock`; retries because another `dvc repro` may be writing the file."""
    for _ in range(_TRIES):
        if not lock.is_file():
            return {}
        try:
            stages: dict[str, Any] = yaml.safe_load(lock.read_text())["stages"]
            return stages
        except (yaml.YAMLError, TypeError, KeyError):
            time.sleep(0.5)
    logger.warning("%s cannot be read: the run will lack the hashes of its data", lock)
    return {}
