"""Write the values of a file of conf/presets/ into params.yaml, which keeps its comments.

python tools/apply_preset.py conf/presets/real.yaml
"""

import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ruamel.yaml import YAML
from ruamel.yaml.comments import CommentedSeq

PARAMS = Path("params.yaml")


def apply_preset(preset: Path, params: Path = PARAMS) -> None:
    """Replace the values of `params` that `preset` names. Raises SystemExit for an unknown key."""
    yaml = YAML()
    yaml.width, yaml.preserve_quotes = 4096, True
    yaml.representer.add_representer(type(None), _null)
    values = yaml.load(params)
    _replace(values, YAML(typ="safe").load(preset), str(preset))
    yaml.dump(values, params)


def _replace(values: Any, changes: Mapping[str, Any], where: str) -> None:
    for name, change in changes.items():
        if name not in values:
            sys.exit(f"error: {where}: {name}: not in params.yaml; remove it from the preset")
        if isinstance(change, Mapping):
            _replace(values[name], change, f"{where}: {name}")
        else:
            values[name] = _on_one_line(change) if isinstance(change, list) else change


def _on_one_line(items: list[Any]) -> CommentedSeq:
    sequence = CommentedSeq(items)
    sequence.fa.set_flow_style()
    return sequence


def _null(representer: Any, _: None) -> Any:
    return representer.represent_scalar("tag:yaml.org,2002:null", "null")


if __name__ == "__main__":
    if len(sys.argv) != 2 or not Path(sys.argv[1]).is_file():
        known = ", ".join(path.stem for path in sorted(Path("conf/presets").glob("*.yaml")))
        sys.exit(f"error: {' '.join(sys.argv[1:])}: no preset; choose from {known}")
    apply_preset(Path(sys.argv[1]))
