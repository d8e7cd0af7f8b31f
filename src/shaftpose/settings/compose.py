"""The settings as a stage gets them, for code that Hydra does not start."""

from pathlib import Path

from hydra import compose, initialize_config_dir
from hydra.core.hydra_config import HydraConfig
from hydra.errors import HydraException
from omegaconf import DictConfig, OmegaConf

from shaftpose.core.errors import InputError
from shaftpose.settings.stage import let_params_choose_preset, resolved_settings
from shaftpose.settings.tree import Settings


def composed_settings(root: Path, *overrides: str) -> Settings:
    """The settings of the project in `root` with overrides as on a stage's command line.

    Raises InputError naming the first wrong key.
    """
    return resolved_settings(composed(root, *overrides), root)


def composed(root: Path, *overrides: str) -> DictConfig:
    """The composed configuration, unchecked, with the output folder `here`.

    Raises InputError if an override is none, or names what conf/ lacks.
    """
    let_params_choose_preset(root)
    with initialize_config_dir(str(root.resolve() / "conf"), version_base="1.3"):
        try:
            config = compose("config", ["out=here", *overrides], return_hydra_config=True)
        except HydraException as error:
            where = " ".join(overrides) or "params.yaml or conf/"
            raise InputError(f"{where}: {str(error).splitlines()[0]}") from error
        HydraConfig.instance().set_config(config)
        OmegaConf.set_struct(config, False)
        del config["hydra"]
    return config
