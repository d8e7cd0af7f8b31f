"""The picture of MLflow's page: which page it is of, and the browser that takes it."""

import asyncio
import shutil
import sys
from pathlib import Path

import cv2
import mlflow
import pytest

from shaftpose import tracking
from shaftpose.errors import InputError

sys.path.insert(0, str(Path(__file__).parents[2] / "tools"))

import browser  # noqa: E402
import ui_screenshot  # noqa: E402


def test_a_server_that_is_tracked_to_shows_its_own_pages() -> None:
    previous = mlflow.get_tracking_uri()
    mlflow.set_tracking_uri("http://tracking.example:5000/")
    try:
        with ui_screenshot.server() as address:
            assert address == "http://tracking.example:5000"
    finally:
        mlflow.set_tracking_uri(previous)


def test_a_sweep_with_nothing_to_compare_is_refused(store: Path) -> None:
    (store / "params.yaml").write_text("tracking: {uri: null, experiment: trials}\n")
    tracking.start_sweep(store / "today", "sweep")
    with tracking.training_run("only", "d", {}, {}, store / "today"):
        pass
    with pytest.raises(InputError, match="today: 1 of its trainings are finished; wait for two"):
        ui_screenshot.comparison(store / "today")


async def picture_of(url: str, condition: str, path: Path) -> None:
    async with browser.open_page((300, 200)) as page:
        await page.show(url)
        await page.wait_until(condition)
        await page.run("document.body.style.background = 'rgb(0, 0, 255)'")
        await page.take_picture(path)


@pytest.mark.skipif(not any(map(shutil.which, browser.BROWSERS)), reason="there is no Chromium")
def test_a_browser_shows_a_page_runs_scripts_and_takes_its_picture(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "page.html").write_text("<body><p>blue</p></body>")
    url = (tmp_path / "page.html").as_uri()
    ready = "document.querySelector('p')?.textContent === 'blue'"
    asyncio.run(picture_of(url, ready, tmp_path / "page.png"))
    pixels = cv2.imread(str(tmp_path / "page.png"))
    assert pixels is not None
    assert pixels[-1, -1].tolist() == [255, 0, 0]  # blue, green, red
    monkeypatch.setattr(browser, "PATIENCE_S", 0.5)
    with pytest.raises(InputError, match="^false: does not come true"):
        asyncio.run(picture_of(url, "false", tmp_path / "none.png"))
    with pytest.raises(InputError, match=r"^nothing\(\): Uncaught"):
        asyncio.run(picture_of(url, "nothing()", tmp_path / "none.png"))
    assert not (tmp_path / "none.png").exists()


def test_without_a_browser_those_that_do_are_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(shutil, "which", lambda _: None)
    with pytest.raises(InputError, match="^none of chromium, .* is installed; install one"):
        asyncio.run(picture_of("about:blank", "true", tmp_path / "none.png"))
