"""Take a picture of MLflow's page that compares the trainings of a sweep, with a real browser.

`python tools/ui_screenshot.py sweeps/TIME --out FILE.png`; Chromium or Chrome must be installed.
"""

import argparse
import asyncio
import json
import os
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from urllib.error import URLError
from urllib.parse import quote
from urllib.request import urlopen

import mlflow
import yaml
from browser import Page, open_page

from shaftpose import tracking
from shaftpose.errors import InputError

PATIENCE_S = 60.0
SIZE_PX = (1500, 980)
METRICS = ("validation/tip_mm", "validation/axis_deg", "validation/mAP")
# Of MLflow's page: the second list to choose from is that of metrics.
_SELECT = "du-bois-light-select"
_CHOSEN = f"document.querySelectorAll('.{_SELECT}')[1].querySelectorAll('"
_OPEN_LIST = f".{_SELECT}-dropdown:not(.{_SELECT}-dropdown-hidden)"


def main() -> None:
    """Take the picture that the command line asks for."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("sweep", type=Path, help="the sweep's folder")
    parser.add_argument("--out", type=Path, required=True, help="the PNG file to write")
    arguments = parser.parse_args()
    try:
        page = comparison(arguments.sweep)
        with server() as address:
            asyncio.run(take_picture(f"{address}/#{page}", arguments.out))
    except InputError as error:
        sys.exit(f"error: {error}")
    print(f"the picture is {arguments.out}")


def comparison(sweep: Path) -> str:
    """The path of the page that compares the finished trainings of a sweep.

    Raises InputError if there are none to compare.
    """
    settings = yaml.safe_load(Path("params.yaml").read_text())["tracking"]
    tracking.connect(**settings)
    runs = [run.run_id for run in tracking.sweep_runs(sweep) if run.finished]
    if len(runs) < 2:
        raise InputError(
            f"{sweep}: {len(runs)} of its trainings are finished; wait for two or more"
        )
    experiment = mlflow.get_experiment_by_name(settings["experiment"])
    listed = quote(json.dumps(runs)), quote(json.dumps([experiment.experiment_id]))
    return "/compare-runs?runs={}&experiments={}&workflowType=machine_learning".format(*listed)


@contextmanager
def server() -> Iterator[str]:
    """The address of MLflow's pages: of the server that is tracked to, or else of one that shows
    the current database to this machine alone."""
    uri = mlflow.get_tracking_uri()
    if uri.startswith(("http://", "https://")):
        yield uri.rstrip("/")
        return
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    address = f"http://127.0.0.1:{port}"
    command = [sys.executable, "-m", "mlflow", "ui", "--host", "127.0.0.1", "--port", str(port),
               "--backend-store-uri", uri]  # fmt: skip
    nowhere = subprocess.DEVNULL
    process = subprocess.Popen(command, start_new_session=True, stdout=nowhere, stderr=nowhere)
    try:
        await_server(address)
        yield address
    finally:
        os.killpg(process.pid, 15)  # the server and its workers
        process.wait()


def await_server(address: str) -> None:
    """Wait until the server answers."""
    end = time.monotonic() + PATIENCE_S
    while time.monotonic() < end:
        try:
            with urlopen(f"{address}/health", timeout=5):
                return
        except (URLError, ConnectionError, TimeoutError):
            time.sleep(0.5)
    raise InputError(f"{address}: MLflow does not answer; try `make ui` to see why")


async def take_picture(url: str, path: Path) -> None:
    """Write what the page shows when its plot is of `METRICS`, the last of which colours the lines.

    By itself it begins with another metric. Raises InputError if the page is not as it is known.
    """
    async with open_page(SIZE_PX) as page:
        await page.show(url)
        await page.wait_until("document.querySelector('.js-plotly-plot text') !== null")
        await page.run("document.querySelector('[aria-label=Close]')?.click()")  # the assistant
        await page.run(f"{_CHOSEN} .{_SELECT}-selection-item-remove')[0].click()")
        for metric in METRICS:
            await _choose(page, metric)
        await page.run("document.body.dispatchEvent(new MouseEvent('mousedown', {bubbles: true}))")
        await page.wait_until(f"document.querySelector('{_OPEN_LIST}') === null")
        for metric in METRICS:
            await page.wait_until(
                "[...document.querySelectorAll('.js-plotly-plot text')]"
                f".some((label) => label.textContent === '{metric}')"
            )
        await page.take_picture(path)


async def _choose(page: Page, metric: str) -> None:
    """Choose a metric as a user does: open the list, type, click."""
    await page.run(
        f"{_CHOSEN} .{_SELECT}-selector')[0]"
        ".dispatchEvent(new MouseEvent('mousedown', {bubbles: true}))"
    )
    # React listens to the native setter alone.
    await page.run(
        f"(() => {{ const input = {_CHOSEN} input')[0];"
        "Object.getOwnPropertyDescriptor(HTMLInputElement.prototype, 'value')"
        f".set.call(input, '{metric}');"
        "input.dispatchEvent(new Event('input', {bubbles: true})); })()"
    )
    option = f"document.querySelector('.{_SELECT}-item-option[title=\"{metric}\"]')"
    await page.wait_until(f"{option} !== null")
    await page.run(f"{option}.click()")


if __name__ == "__main__":
    main()
