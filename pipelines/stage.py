"""What all stage scripts share: Hydra in front, one-line errors behind."""

import functools
import logging
import sys
from collections.abc import Callable
from pathlib import Path

import hydra
from hydra.core.hydra_config import HydraConfig
from hydra.types import RunMode
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException
from settings import Config, check, size

from shaftpose.errors import InputError

logger = logging.getLogger(__name__)

__all__ = ["SCRATCH", "Config", "stage"]

# From it, interrupted renders and trainings go on.
SCRATCH = Path("data/scratch")


def stage(function: Callable[[Config], None]) -> Callable[[], None]:
    """Make a function of the composed configuration the main function of its script.

    What the user can mend ends the script with one line and status 1, without a traceback. A job of
    a sweep says it and fails alone: Hydra goes on with the others, and ends with status 1.
    """

    @functools.wraps(function)
    def run(composed: DictConfig) -> None:
        try:
            config = _resolved(composed)
            check(config)
            function(config)
        except InputError as error:
            if HydraConfig.get().mode is RunMode.MULTIRUN:
                logger.error("error: %s", last_line(error))
                raise
            sys.exit(f"error: {last_line(error)}")
        except KeyboardInterrupt:
            sys.exit(
                "interrupted; the same command goes on from finished shards or the last "
                "checkpoint, that of a sweep if hydra.sweep.dir=FOLDER names its folder"
            )

    main: Callable[[], None] = hydra.main(
        config_path="../conf", config_name="config", version_base="1.3"
    )(run)
    return main


def last_line(error: InputError) -> str:
    """The message itself: from a data loader's process it comes behind that process's traceback."""
    return str(error).strip().splitlines()[-1].removeprefix(f"{_full_name(InputError)}: ")


def _full_name(kind: type) -> str:
    return f"{kind.__module__}.{kind.__qualname__}"


def _resolved(composed: DictConfig) -> Config:
    if composed.profile not in composed.profiles:
        known = ", ".join(str(name) for name in composed.profiles)
        raise InputError(
            f"params.yaml: profile = {composed.profile!r}: unknown; choose one of {known}"
        )
    try:
        # Before other parts refer to a size that is missing.
        sizes = OmegaConf.to_container(composed.profiles[composed.profile], resolve=True)
        size({"profile": composed.profile, "size": sizes})
        config = OmegaConf.to_container(composed, resolve=True)
    except OmegaConfBaseException as error:
        raise InputError(f"params.yaml or conf/: {str(error).splitlines()[0]}") from error
    assert isinstance(config, dict)
    return {str(key): value for key, value in config.items()}
