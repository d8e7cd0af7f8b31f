"""The main function shared by all stage scripts: Hydra's settings and one-line errors."""

import functools
import logging
import sys
from collections.abc import Callable
from pathlib import Path

import hydra
import yaml
from hydra.core.hydra_config import HydraConfig
from hydra.types import RunMode
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

from shaftpose.core.errors import InputError
from shaftpose.settings.parsing import parse
from shaftpose.settings.schema import RunSize
from shaftpose.settings.tree import Settings, read_settings

logger = logging.getLogger(__name__)


def stage(function: Callable[[Settings], None]) -> Callable[[], None]:
    """Turn a function of the settings into the main function of its script in pipelines/.

    An error that the user can fix ends the script with one line and status 1, without a traceback.
    In a sweep only the job fails: Hydra runs the others and exits with status 1.
    """
    root = Path(function.__code__.co_filename).resolve().parents[1]
    let_params_choose_preset(root)

    @functools.wraps(function)
    def run(composed: DictConfig) -> None:
        try:
            function(resolved_settings(composed, root))
        except InputError as error:
            if HydraConfig.get().mode is RunMode.MULTIRUN:
                logger.error("error: %s", last_line(error))
                raise
            sys.exit(f"error: {last_line(error)}")
        except KeyboardInterrupt:
            sys.exit(
                "interrupted; run the same command to resume from finished shards or the last "
                "checkpoint (for a sweep, add hydra.sweep.dir=FOLDER with its folder)"
            )

    main: Callable[[], None] = hydra.main(
        config_path=str(root / "conf"), config_name="config", version_base="1.3"
    )(run)
    return main


def let_params_choose_preset(root: Path) -> None:
    """Make `${preset:}` in conf/config.yaml the value of `preset` in params.yaml.

    A plain `${preset}` would fail: Hydra chooses the files to compose before it reads any value.
    `preset=NAME` on the command line overrides it.
    """

    def preset() -> str:
        return str(yaml.safe_load((root / "params.yaml").read_text())["preset"])

    OmegaConf.register_new_resolver("preset", preset, replace=True)


def last_line(error: InputError) -> str:
    """The message itself, without the traceback that a data loader's process puts before it."""
    return str(error).strip().splitlines()[-1].removeprefix(f"{_full_name(InputError)}: ")


def _full_name(kind: type) -> str:
    return f"{kind.__module__}.{kind.__qualname__}"


def resolved_settings(composed: DictConfig, root: Path) -> Settings:
    """The settings of a composed configuration. Raises InputError naming the first wrong key."""
    if composed.profile not in composed.profiles:
        known = ", ".join(str(name) for name in composed.profiles)
        raise InputError(
            f"params.yaml: profile = {composed.profile!r}: unknown; choose one of {known}"
        )
    try:
        # Checked first, because other parts refer to the sizes.
        sizes = OmegaConf.to_container(composed.profiles[composed.profile], resolve=True)
        parse(RunSize, sizes, f"conf/profiles.yaml: {composed.profile}.")
        config = OmegaConf.to_container(composed, resolve=True)
    except OmegaConfBaseException as error:
        raise InputError(f"params.yaml or conf/: {str(error).splitlines()[0]}") from error
    assert isinstance(config, dict)
    return read_settings({str(k): v for k, v in config.items() if k != "profiles"}, root)
