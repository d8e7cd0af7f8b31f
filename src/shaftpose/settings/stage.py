"""The main function shared by all stage scripts: Hydra's settings and one-line errors."""

import functools
import logging
import sys
import traceback
from collections.abc import Callable
from pathlib import Path

import hydra
from hydra.core.hydra_config import HydraConfig
from hydra.types import RunMode
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

from shaftpose.core.errors import InputError, exit_on_input_error
from shaftpose.settings.parsing import parse
from shaftpose.settings.schema import RunSize
from shaftpose.settings.tree import Settings, read_settings, read_yaml

logger = logging.getLogger(__name__)

_ERROR = "error.txt"


def stage(function: Callable[[Settings], None]) -> Callable[[], None]:
    """Turn a function of the settings into the main function of its script in pipelines/.

    An error that the user can fix ends the script with one line and status 1, without a traceback.
    In a sweep any error ends its job alone and is kept in the job's folder, see `failed_jobs`.
    """
    root = Path(function.__code__.co_filename).resolve().parents[1]
    with exit_on_input_error():
        let_params_choose_preset(root)

    @functools.wraps(function)
    def run(composed: DictConfig) -> None:
        try:
            function(resolved_settings(composed, root))
        except Exception as error:
            known = f"error: {last_line(error)}" if isinstance(error, InputError) else None
            if HydraConfig.get().mode is RunMode.RUN:
                if known is None:
                    raise
                sys.exit(known)
            # Raised, it would keep Hydra from ending the sweep, and so from summarising it.
            text = known or traceback.format_exc()
            logger.error("%s", text)
            (Path(HydraConfig.get().runtime.output_dir) / _ERROR).write_text(f"{text}\n")
        except KeyboardInterrupt:
            sys.exit(
                "interrupted; run the same command to resume from finished shards or the last "
                "checkpoint (for a sweep, add hydra.sweep.dir=FOLDER with its folder)"
            )

    main: Callable[[], None] = hydra.main(
        config_path=str(root / "conf"), config_name="config", version_base="1.3"
    )(run)
    return main


def failed_jobs(sweep: Path) -> list[Path]:
    """The files with the errors that have ended jobs of the sweep in this folder."""
    return sorted(sweep.glob(f"*/{_ERROR}"))


def let_params_choose_preset(root: Path) -> None:
    """Make `${preset:}` in conf/config.yaml the value of `preset` in params.yaml.

    A plain `${preset}` would fail: Hydra chooses the files to compose before it reads any value.
    `preset=NAME` on the command line overrides it. Raises InputError if the file, or that of the
    profiles, is no YAML: Hydra would show its own traceback.
    """
    remedy = "take it from git again, then repeat your change"
    params, _ = (
        read_yaml(root / name, f"{name}: ", remedy)
        for name in ("params.yaml", "conf/profiles.yaml")
    )
    if "preset" not in params:
        raise InputError("params.yaml: lacks `preset`; set it to none")
    OmegaConf.register_new_resolver("preset", lambda: str(params["preset"]), replace=True)


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
