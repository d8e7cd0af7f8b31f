"""The settings as a stage gets them, for code that Hydra does not start."""

from pathlib import Path

from hydra import compose, initialize_config_dir
from hydra.core.hydra_config import HydraConfig
from omegaconf import DictConfig, OmegaConf

from shaftpose.settings.stage import let_params_choose_preset, resolved_settings
from shaftpose.settings.tree import Settings


def composed_settings(root: Path, *overrides: str) -> Settings:
    """The settings of the project in `root` with overrides as on a stage's command line.

    Raises InputError naming the first wrong key.
    """
    return resolved_settings(composed(root, *overrides), root)


def composed(root: Path, *overrides: str) -> DictConfig:
    """The composed configuration, unchecked, with the output folder `here`."""
    let_params_choose_preset(root)
    with initialize_config_dir(str(root.resolve() / "conf"), version_base="1.3"):
        config = compose("config", ["out=here", *overrides], return_hydra_config=True)
        HydraConfig.instance().set_config(config)
        OmegaConf.set_struct(config, False)
        del config["hydra"]
    return config
