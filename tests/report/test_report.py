"""The report's texts: complete, honest about what is missing, and self-contained."""

import json
import re
import shutil
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from matplotlib.figure import Figure
from playwright.sync_api import Browser, sync_playwright

from shaftpose.core.errors import InputError
from shaftpose.figures.style import save_figure
from shaftpose.metrics.binned_errors import ErrorBin
from shaftpose.metrics.summary import ErrorSummary, Summary
from shaftpose.origin import Origin
from shaftpose.report import page as texts
from shaftpose.report import paper_numbers
from shaftpose.report.ablation import AblationReport, VariantRow, variant_rows
from shaftpose.report.champion import Champion
from shaftpose.report.page import to_json, to_markdown
from tests.evaluations import accuracy, evaluation

METRICS = {"mAP": 0.8121, "detected_rate": 0.7, "x_mm": 2.345, "yaw_deg": float("nan")}
LINKS = {"D": "http://127.0.0.1:5000/#/experiments/1/runs/ab"}
RULE = "The lowest mean tip error on the validation images."


def row(variant: str, title: str = "") -> VariantRow:
    mixed_in = 100 if variant == "d_noise_real" else 0
    return VariantRow(
        variant, METRICS, 900, 100, 3000, 16, 0.25, 0.5, "muon", 700, (0,), 1_234_567, mixed_in,
        title,
    )  # fmt: skip


def score(rate: float, iou: float | None) -> dict[str, float | int | None]:
    return {"detected_rate": rate, "iou": iou, "images": 20, "instruments": 31}


@pytest.fixture
def report() -> AblationReport:
    silhouettes = {
        "d_noise": {"rendered/clear": score(0.91, 0.52), "stand-in/clear": score(0.61, 0.22)},
        "mine": {"stand-in/clear": score(0.63, None), "stand-in/occluded": score(0.64, 0.24)},
    }
    rows = [row("c"), row("d"), row("d_noise"), row("d_noise_real"), row("mine", "D <wide> | deep")]
    rows = [replace(one, silhouettes=silhouettes.get(one.variant, {})) for one in rows]
    constant = {"mAP": 0.001, "x_mm": 10.17}
    return AblationReport(rows, constant, "stand-in", Champion("d_noise", False, RULE), "demo")


def to_html(report: AblationReport) -> str:
    """The page with one figure."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "figure.png"
        save_figure(Figure(figsize=(1, 1)), path)
        return texts.to_html(report, {"Curves": path}, {"D": path}, LINKS)


def markdown_line(text: str, start: str) -> list[str]:
    line = next(line for line in text.splitlines() if line.startswith(start))
    return [cell.strip() for cell in re.split(r"(?<!\\)\|", line)[1:-1]]


def test_markdown_sets_the_paper_beside_ours(report: AblationReport):
    text = to_markdown(report)
    assert markdown_line(text, "| D |")[:6] == [
        "D", "90,000 / 900", "n/a / 3,000", "0.949 / 0.812", "0.956 / 0.700", "0.81 / 2.35",
    ]  # fmt: skip
    assert markdown_line(text, "| **D + noise** |")[3] == "0.965 / 0.812"
    assert markdown_line(text, "| Constant predictor |")[3:6] == ["0.001", "n/a", "10.17"]


def test_missing_and_nan_values_read_not_available(report: AblationReport):
    cells = markdown_line(to_markdown(report), "| D |")
    assert cells[9] == "5.30 / n/a"  # our yaw is NaN
    assert cells[11] == "n/a / n/a"  # neither has a tip error
    for text in (to_markdown(report), to_html(report), to_json(report)):
        assert not re.search(r"\bnan\b", text, re.IGNORECASE)
        assert "None" not in text


def test_every_variant_appears_in_every_form(report: AblationReport):
    titles = ["C", "D", "D + noise", "D + noise + stand-in"]
    page, text = to_html(report), to_markdown(report)
    for title in titles:
        assert re.search(rf"<td>(<strong>)?{re.escape(title)}<", page)
        assert markdown_line(text, f"| {title} |" if title != "D + noise" else "| **D + noise** |")
    content = json.loads(to_json(report))
    names = [entry["variant"] for entry in content["rows"]]
    assert names == ["c", "d", "d_noise", "d_noise_real", "mine"]


def test_an_unknown_variant_has_its_own_title_and_no_paper_row(report: AblationReport):
    cells = markdown_line(to_markdown(report), "| D &lt;wide&gt;")
    assert cells[:5] == ["D &lt;wide&gt; \\| deep", "900", "3,000", "0.812", "0.700"]
    page = to_html(report)
    assert "<td>D &lt;wide&gt; | deep</td>" in page and "<wide>" not in page
    assert json.loads(to_json(report))["rows"][-1]["paper"] is None
    assert row("untitled").shown_title("real") == "untitled"
    assert row("mine", "C + real + wide").shown_title("stand-in") == "C + stand-in + wide"


def test_refined_poses_have_a_row_of_their_own_that_the_paper_lacks(report: AblationReport):
    fitted = replace(row("d"), refinement="fit")
    text = to_markdown(replace(report, rows=[*report.rows, fitted]))
    assert markdown_line(text, "| D + fit |")[:4] == ["D + fit", "900", "3,000", "0.812"]


@pytest.mark.parametrize(
    ("refine", "title"),
    [("mask", "D + fit"), ("edges", "D + fit"), ("views", "D + 8 views")],
)
def test_a_refined_row_says_how(refine: str, title: str) -> None:
    found = replace(evaluation("D", refined=accuracy()), detection={"refine": refine})
    assert [row.shown_title("real") for row in variant_rows("d", found)] == ["D", title]


def test_the_scale_stands_under_the_tables(report: AblationReport):
    for text in (to_markdown(report), to_html(report)):
        assert "900 training images (at most 1 % of the paper" in text
        assert "100 test images, 3,000 steps, batch 16, backbone width 0.25, depth 0.5" in text
        assert "20 images with 31 instruments" in text
        assert RULE in text
    assert markdown_line(to_markdown(report), "| Variant | Tr")[1] == "Training images"


def test_the_networks_of_variants_are_told_by_width_and_depth(report: AblationReport):
    lines = [line.split(" | ") for line in to_markdown(report).splitlines()]
    headings, _, _, d, *_ = lines[next(n for n, line in enumerate(lines) if "Width" in line) :]
    setup = dict(zip(headings, d, strict=True))
    assert (setup["| Variant"], setup["Width"], setup["Depth"]) == ("| D", "0.25", "0.5")


def test_intervals_and_spreads_are_shown_where_they_were_computed(report: AblationReport):
    title = "Intervals and spread of the errors"
    assert title not in to_markdown(report) and title not in to_html(report)
    error = ErrorSummary(mean=1.5, interval=(1.25, 1.75), median=1.0, p95=4.0)
    found = Summary((0.7, 0.9), None, 0.5, {"tip_mm": error})
    with_summary = replace(report, rows=[replace(report.rows[1], summary=found), *report.rows[2:]])
    line = markdown_line(to_markdown(with_summary).split(title)[1], "| D |")
    assert line[:6] == [
        "D", "0.700 to 0.900", "n/a", "0.500", "1.00; 4.00 (1.25 to 1.75)", "n/a",
    ]  # fmt: skip
    assert title in to_html(with_summary) and "1.00; 4.00 (1.25 to 1.75)" in to_html(with_summary)


def test_the_bias_of_the_depth_is_shown_where_it_was_measured(report: AblationReport):
    assert "Near and far" not in to_markdown(report) and "Near and far" not in to_html(report)
    depths = (
        ErrorBin(10, 25, 9, 1.0, 1.0, z_bias_mm=1.204),
        ErrorBin(25, 40, 9, 1.0, 1.0, z_bias_mm=-0.5),
        ErrorBin(40, 55, 4, 1.0, 1.0, z_bias_mm=9.9),  # too few
    )
    older = tuple(replace(one, z_bias_mm=None) for one in depths)
    c, d, *_ = report.rows
    measured = replace(report, rows=[replace(c, depths=older), replace(d, depths=depths)])
    text = to_markdown(measured).split("Near and far")[1].split("Table II")[0]
    assert markdown_line(text, "| Variant") == [
        "Variant", "10 to 25 mm", "25 to 40 mm", "40 to 55 mm",
    ]  # fmt: skip
    assert markdown_line(text, "| D |") == ["D", "+1.20", "-0.50", "n/a"]
    assert "| C |" not in text
    assert "+1.20" in to_html(measured)
    assert json.loads(to_json(measured))["rows"][1]["depths"][0]["z_bias_mm"] == 1.204


def test_errors_in_the_image_and_intervals_of_iou_are_shown(report: AblationReport):
    assert "Tip and axis in the image" not in to_html(report)
    measured = {
        **score(0.9, 0.5), "iou_low": 0.41, "iou_high": 0.62, "tip_px": 2.25, "image_axis_deg": 1.5,
        "axis_px": 3.75,
    }  # fmt: skip
    text = to_markdown(
        replace(report, rows=[replace(row("d"), silhouettes={"rendered/clear": measured})])
    )
    assert markdown_line(text, "| rendered | D |")[3] == "0.500 (0.41 to 0.62)"
    line = markdown_line(text.split("Tip and axis in the image")[1], "| rendered | D |")
    assert line == ["rendered", "D", "2.2", "1.5", "3.8", "n/a", "n/a", "n/a"]


def test_the_report_says_how_its_numbers_were_made(report: AblationReport):
    title = "How these numbers were made"
    assert title not in to_markdown(report) and title not in to_html(report)
    made = Origin("python pipelines/evaluate.py variant=d", "0123456789ab+", "A processor, 4 cores")
    d = replace(report.rows[1], origin=made, data=("aabb", "ccdd"), training_id="feed")
    known = replace(report, rows=[report.rows[0], d])
    text = to_markdown(known).split(title)[1]
    assert "profile demo" in text
    assert markdown_line(text, "| D |") == ["D", *vars(made).values(), "aabb, ccdd", "feed"]
    assert "| C |" not in text
    page = to_html(known)
    assert all(value in page for value in (title, *vars(made).values(), "aabb, ccdd", "feed"))
    assert json.loads(to_json(known))["rows"][1]["origin"] == vars(made)


def test_mixed_in_images_are_counted(report: AblationReport):
    told = (
        "D + noise + stand-in: 100 stand-in images were mixed in with the rendered ones; "
        "the paper's D + noise + real has real ones."
    )
    assert told in to_markdown(report)
    assert to_markdown(report).count("mixed in") == 1
    real = to_markdown(measured_on_real(report))
    assert "D + noise + real: 100 real images were mixed in with the rendered ones." in real


def test_stand_ins_are_never_shown_as_real(report: AblationReport):
    text, page, content = to_markdown(report), to_html(report), json.loads(to_json(report))
    assert markdown_line(text, "| real / stand-in |")[2] == "0.700 / 0.610"
    assert markdown_line(text, "| stand-in |")[1:] == [
        "D &lt;wide&gt; \\| deep", "0.630", "n/a", "0.640", "0.240",
    ]  # fmt: skip
    assert "not evidence about real ones" in page
    assert "<td>stand-in</td>" in page and "<td>real / stand-in</td>" in page
    assert "<td>real</td>" not in page and "/ real</td>" not in page
    assert set(content["rows"][2]["silhouettes"]) == {"rendered/clear", "stand-in/clear"}


def measured_on_real(report: AblationReport) -> AblationReport:
    rows = [
        replace(
            one, silhouettes={n.replace("stand-in", "real"): s for n, s in one.silhouettes.items()}
        )
        for one in report.rows
    ]
    return replace(report, domain_label="real", rows=rows)


def test_measured_real_images_are_called_real(report: AblationReport):
    real = measured_on_real(report)
    for text in (to_markdown(real), to_html(real), to_json(real)):
        assert "stand-in" not in text
    assert markdown_line(to_markdown(real), "| real / real |")[2] == "0.700 / 0.610"


def test_an_unclear_domain_is_refused(report: AblationReport):
    with pytest.raises(InputError, match="domain_label is 'synthetic'"):
        replace(report, domain_label="synthetic")


def test_html_needs_no_other_file(report: AblationReport):
    page = to_html(report)
    assert not re.search(r"<script|<link|@import|url\(", page)
    assert re.findall(r"https?://[^\"]+", page) == re.findall('<a href="([^"]+)"', page)
    sources = re.findall(r'src="([^"]*)"', page)
    assert len(sources) == 2  # a row of predictions and a figure
    assert all(source.startswith("data:image/png;base64,iVBORw0KGgo") for source in sources)


def test_the_page_leads_to_the_runs_in_mlflow(report: AblationReport):
    assert f'<a href="{LINKS["D"]}">D</a>' in to_html(report)


def test_rows_say_their_weights_and_what_else_differs(report: AblationReport):
    loss = {"loss.alpha": 1.5, "loss.gamma": 5.0, "loss.beta": [1.0, 1.0, 2.0, 2.0, 2.0]}
    settings = (
        loss | {"noise": 0, "start": True},
        loss | {"noise": 10, "start": True},
        {"noise": 0},
    )
    rows = [replace(one, settings=s) for one, s in zip(report.rows[:3], settings, strict=True)]
    text = to_markdown(replace(report, rows=[*rows, replace(rows[0], refinement="fit")]))
    section = text.partition("## What differs")[2].partition("## Table I")[0]
    table = [line.strip("| ").split(" | ") for line in section.splitlines() if "|" in line]
    assert table == [
        ["Variant", "alpha", "gamma", "beta", "noise", "start"],
        ["---"] * 6,
        ["C", "1.5", "5", "1, 1, 2, 2, 2", "0", "True"],
        ["D", "1.5", "5", "1, 1, 2, 2, 2", "10", "True"],
        ["D + noise", "n/a", "n/a", "n/a", "0", "n/a"],
    ]
    assert "What differs" not in to_markdown(report)


def test_a_missing_figure_is_named(report: AblationReport):
    with pytest.raises(InputError, match="nowhere/curves.png"):
        texts.to_html(report, {"Curves": Path("nowhere/curves.png")}, {}, {})


def test_json_holds_plain_numbers_and_nulls(report: AblationReport):
    content = json.loads(to_json(report))
    d = content["rows"][1]
    assert d["metrics"]["mAP"] == 0.8121 and d["metrics"]["yaw_deg"] is None
    assert d["paper"]["yaw_deg"] == 5.30 and d["training_images"] == 900
    assert content["rows"][4]["silhouettes"]["stand-in/clear"]["iou"] is None


def test_paper_tables_hold_the_papers_numbers():
    c, real = paper_numbers.TABLE_I["c"], paper_numbers.TABLE_I["d_noise_real"]
    assert (c.mAP, c.detected_rate, c.x_mm, c.yaw_deg) == (0.958, 0.937, 1.51, 13.58)
    assert (real.detected_rate, real.z_mm, real.pitch_deg) == (0.988, 0.77, 1.44)
    assert paper_numbers.TABLE_I["d"].fps == 30.4
    assert paper_numbers.TABLE_II["d_noise"]["real/occluded"].iou == 0.195
    assert paper_numbers.TABLE_II["d_noise_real"]["rendered/clear"].detected_rate == 0.950
    assert "rendered/clear" not in paper_numbers.TABLE_II["d_noise"]


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    found = filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome")))
    path = next(found, None)
    if path is None:
        pytest.skip("needs the browser Chromium: sudo apt-get install -y chromium")
    with sync_playwright() as playwright:
        # The sandbox needs a user who is not root.
        chromium = playwright.chromium.launch(executable_path=path, args=["--no-sandbox"])
        yield chromium
        chromium.close()


@pytest.mark.parametrize("width", [1400, 390])
def test_a_browser_shows_the_page_whole(
    report: AblationReport, browser: Browser, width: int, tmp_path: Path
) -> None:
    file = tmp_path / "ablation.html"
    file.write_text(to_html(report))
    page = browser.new_page(viewport={"width": width, "height": 800})
    complaints: list[str] = []
    page.on("console", lambda message: complaints.append(message.text))
    page.on("pageerror", lambda error: complaints.append(str(error)))
    requests: list[str] = []
    page.on("request", lambda request: requests.append(request.url))
    page.goto(file.as_uri())
    assert not complaints
    assert [url for url in requests if not url.startswith("data:")] == [file.as_uri()]
    widths = page.eval_on_selector_all("img", "images => images.map(i => i.naturalWidth)")
    assert len(widths) == 2 and min(widths) > 0
    # Wide tables scroll on their own; the page does not.
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    # The variants' names stay in view.
    moved = """() => {
        const table = document.querySelectorAll("section")[1].querySelector("table");
        table.scrollLeft = table.scrollWidth;
        const name = table.querySelector("tbody td");
        return name.getBoundingClientRect().left - table.getBoundingClientRect().left;
    }"""
    assert page.evaluate(moved) == pytest.approx(0, abs=1)
    page.close()


def test_no_table_is_cut_on_paper(report: AblationReport, browser: Browser, tmp_path: Path) -> None:
    error = ErrorSummary(mean=1.5, interval=(1.25, 1.75), median=1.0, p95=4.0)
    names = ("tip_mm", "axis_deg", "add_s_mm", "mssd_mm", "mspd_px")
    spread = Summary((0.7, 0.9), (0.7, 0.9), 0.5, dict.fromkeys(names, error))
    made = Origin("python pipelines/evaluate.py variant=d out=reports/d results=data/results/d",
                  "0123456789ab+", "x86_64 Intel(R) Xeon(R) Processor, 16 cores")  # fmt: skip
    rows = [replace(row, summary=spread, origin=made, training_id=32 * "a") for row in report.rows]
    file = tmp_path / "ablation.html"
    file.write_text(to_html(replace(report, rows=rows)))
    page = browser.new_page(viewport={"width": 1031, "height": 702})  # 273 mm x 186 mm
    page.emulate_media(media="print")
    page.goto(file.as_uri())
    beyond = """tables => tables.map(table => table.getBoundingClientRect().right
                                 - table.closest("section").getBoundingClientRect().right)"""
    assert max(page.eval_on_selector_all("table", beyond)) <= 0
    assert page.evaluate("document.documentElement.scrollWidth") <= 1031
    page.close()
