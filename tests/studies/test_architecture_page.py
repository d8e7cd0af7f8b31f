"""docs/architecture.md agrees with the code: its names exist and its tables are up to date."""

import importlib
import importlib.util
import re
from functools import reduce
from pathlib import Path

import pytest
import yaml

from studies import architecture_tables
from tests.test_architecture import FOLDERS

ROOT = Path(__file__).parents[2]

PAGE = (ROOT / "docs/architecture.md").read_text()
# `module.Class.method` in one of `PACKAGES`.
NAMES = sorted(set(re.findall(r"`([a-z]\w*(?:\.\w+)+)`", PAGE)))


PACKAGES = ("shaftpose.network.ssd", "shaftpose.network", "shaftpose.training", "shaftpose.core")


def test_names_of_the_page_are_known() -> None:
    named = [name for name in NAMES if not name.endswith((".yaml", ".md"))]
    assert len(named) > 20
    for name in named:
        module, *attributes = name.split(".")
        (path,) = [p for p in PACKAGES if importlib.util.find_spec(f"{p}.{module}")]
        found = importlib.import_module(f"{path}.{module}")
        assert reduce(getattr, attributes, found), name


def test_folders_are_listed_below_those_that_they_import() -> None:
    listed = re.findall(r"^\| `(\w+)/` \|", PAGE, re.MULTILINE)
    assert set(listed) == FOLDERS.keys()
    for place, folder in enumerate(listed):
        assert set(FOLDERS[folder]) <= set(listed[:place]), folder


def test_what_one_may_change_is_where_the_page_says() -> None:
    rows = re.findall(r"\| `([\w/]+\.py)` \| `(\w+)` \|$", PAGE, re.MULTILINE)
    assert len(rows) > 15
    for path, name in rows:
        code = (ROOT / "src/shaftpose" / path).read_text()
        assert re.search(rf"^(class |def |){name}\b", code, re.MULTILINE), (path, name)


def test_tables_are_those_of_the_code() -> None:
    assert architecture_tables.page(PAGE) == PAGE, "run `make architecture`"


def test_variants_with_one_network_share_a_row() -> None:
    groups = [names.split(", ") for names in architecture_tables.networks()]
    variants = {path.stem for path in (ROOT / "conf/variant").glob("*.yaml")}
    # A detector learns no poses, and E is dense: they are none of the paper's networks.
    assert sorted(name for group in groups for name in group) == sorted(
        variants - {"detector", "e", "e_real"}
    )
    (group,) = [group for group in groups if "d" in group]
    assert {"d_noise", "d_noise_real"} <= set(group)
    assert not {"b", "c"} & set(group)


def test_counts_by_hand() -> None:
    """C's head at width and depth 1: 3 x 3 convolutions with bias, 11 values for each box."""
    channels, boxes = (384, 1024, 1536, 512, 256, 256), (4, 6, 6, 6, 4, 4)
    sizes = (35, 17, 9, 5, 3, 2)
    c = architecture_tables.build("c", width=1.0, depth=1.0)
    weights = [9 * n * 11 * k for n, k in zip(channels, boxes, strict=True)]
    assert architecture_tables.parameters(c.head) == sum(weights) + 11 * sum(boxes)
    head = sum(2 * w * size**2 for w, size in zip(weights, sizes, strict=True)) / 1e9
    flops = architecture_tables.flops
    assert flops(c) - flops(c.backbone) == pytest.approx(head)


def test_stages_name_the_blocks_of_each_depth() -> None:
    """The published 4, 7 and 3 blocks, and a quarter of each."""
    assert architecture_tables.stages(1.0, 0.25)[:3] == [
        "stem, 4 / 1 Inception-A",
        "Reduction-A, 7 / 2 Inception-B",
        "Reduction-B, padded, 3 / 1 Inception-C",
    ]


def test_profiles_of_one_size_stand_together() -> None:
    sizes = architecture_tables.sizes()
    assert len(set(sizes.values())) == len(sizes)
    profiles = yaml.safe_load((ROOT / "conf/profiles.yaml").read_text())
    found = {name: size for names, size in sizes.items() for name in names.split(", ")}
    assert found == {
        name: (profiles[name]["width"], profiles[name]["depth"])
        for name in ("paper", "bench", "demo")
    }


def test_what_classes_cost_by_hand() -> None:
    """The distance of a value from the centre of its class is a quarter of the class on average."""
    coder = architecture_tables.pose_coder("b")
    errors = architecture_tables.rounding_errors(coder)  # type: ignore[arg-type]
    expected = {"x_mm": 0.25, "y_mm": 0.25, "z_mm": 0.25, "pitch_deg": 1.25, "yaw_deg": 1.25}
    assert {name: errors[name] for name in expected} == pytest.approx(expected, rel=0.03)
