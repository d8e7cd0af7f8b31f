"""What all stage scripts share: Hydra in front, one-line errors behind."""

import functools
import sys
from collections.abc import Callable
from typing import Any

import hydra
from omegaconf import DictConfig, OmegaConf

from shaftpose.errors import InputError

Config = dict[str, Any]


def stage(function: Callable[[Config], None]) -> Callable[[], None]:
    """Make a function of the composed configuration the main function of its script.

    An InputError ends the script with its one line and status 1, without a traceback.
    """

    @functools.wraps(function)
    def run(composed: DictConfig) -> None:
        try:
            _check_profile(composed)
            config = OmegaConf.to_container(composed, resolve=True)
            assert isinstance(config, dict)
            function({str(key): value for key, value in config.items()})
        except InputError as error:
            sys.exit(f"error: {error}")

    main: Callable[[], None] = hydra.main(
        config_path="../conf", config_name="config", version_base="1.3"
    )(run)
    return main


def _check_profile(composed: DictConfig) -> None:
    if composed.profile not in composed.profiles:
        known = ", ".join(str(name) for name in composed.profiles)
        raise InputError(
            f"params.yaml: profile = {composed.profile!r}: unknown; choose one of {known}"
        )
