"""Write docs/results.md from the files of results that are in the repository: `make results`."""

import json
import sys
from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

import yaml

from shaftpose.errors import InputError
from shaftpose.evaluation.ablation import AblationReport, Champion, VariantRow
from shaftpose.evaluation.results_page import to_page

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs/results.md"


def main() -> None:
    """Write the page."""
    try:
        PAGE.write_text(page(ROOT))
    except InputError as error:
        sys.exit(f"error: {error}")
    print(f"written to {PAGE.relative_to(ROOT)}")


def page(root: Path) -> str:
    """The page of the results below `root`."""
    recorded = root / "reports/ablation.json"
    if not recorded.is_file():
        raise InputError(f"{recorded}: missing; run `make report`")
    report = read_report(json.loads(recorded.read_text()))
    profiles = yaml.safe_load((root / "conf/profiles.yaml").read_text())
    trainings = [read_row(row) for row in contents(root / "reports/trainings").values()]
    benchmarks = contents(root / "benchmarks/results")
    return to_page(report, profile_of(report.rows, profiles), trainings, benchmarks)


def read_report(content: dict[str, Any]) -> AblationReport:
    """The report that the pipeline wrote as ablation.json."""
    return AblationReport(
        rows=[read_row(row) for row in content["variants"]],
        constant=content["constant_predictor"],
        silhouette=content["silhouette"],
        domain_label=content["domain_label"],
        champion=Champion(**content["champion"]),
    )


def read_row(content: dict[str, Any]) -> VariantRow:
    """A training's row, less what ablation.json adds to it."""
    names = {field.name for field in fields(VariantRow)} & content.keys()
    return VariantRow(**{n: content[n] for n in names} | {"seeds": tuple(content["seeds"])})


def contents(folder: Path) -> dict[str, Any]:
    """The JSON files of a folder by name."""
    return {path.stem: json.loads(path.read_text()) for path in sorted(folder.glob("*.json"))}


def profile_of(rows: Sequence[VariantRow], profiles: dict[str, dict[str, Any]]) -> str:
    """The profile that has the rows' width, batch size and steps."""
    sizes = {(row.width, row.batch_size, row.steps) for row in rows}
    for name, profile in profiles.items():
        if sizes == {(profile["width"], profile["batch_size"], profile["steps"])}:
            return name
    raise InputError(
        f"reports/ablation.json: no profile of conf/profiles.yaml has its {sorted(sizes)} (width, "
        "batch size, steps); run `make repro`, which brings the report up to date"
    )


if __name__ == "__main__":
    main()
