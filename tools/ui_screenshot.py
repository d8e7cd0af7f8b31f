"""Take a picture of MLflow's page that compares the trainings of a sweep, with a real browser.

`python tools/ui_screenshot.py sweeps/TIME --out FILE.png`; Chromium or Chrome must be installed.
"""

import argparse
import json
import os
import shutil
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

from shaftpose import tracking
from shaftpose.errors import InputError

BROWSERS = ("chromium", "chromium-browser", "google-chrome")
PATIENCE_S = 60.0
# The page asks the server for its data; so long it is given, in the browser's own time.
SETTLED_MS = 30_000
SIZE_PX = (1500, 1100)
TITLE = "Parallel Coordinates Plot"  # stands on the page when its data are there


def main() -> None:
    """Take the picture that the command line asks for."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("sweep", type=Path, help="the sweep's folder")
    parser.add_argument("--out", type=Path, required=True, help="the PNG file to write")
    arguments = parser.parse_args()
    try:
        page = comparison(arguments.sweep)
        with server() as address:
            take_picture(f"{address}/#{page}", arguments.out)
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


def take_picture(url: str, path: Path) -> None:
    """Write what a browser without a window shows when the page has its data.

    Raises InputError if it does not show `TITLE`: a page that could not load has a picture, too.
    """
    path.unlink(missing_ok=True)
    if TITLE not in browse(url, "--dump-dom"):
        raise InputError(f"{url}: the page does not show {TITLE!r}; open it to see why")
    browse(url, f"--screenshot={path.resolve()}")
    if not path.is_file():
        raise InputError(f"{path}: no picture of {url} was taken; open it to see why")


def browse(url: str, wanted: str) -> str:
    """What the browser prints when it opens a page for what the option `wanted` asks."""
    browser = next(filter(None, map(shutil.which, BROWSERS)), None)
    if browser is None:
        raise InputError(f"none of {', '.join(BROWSERS)} is installed; install one of them")
    options = [
        "--headless=new", "--hide-scrollbars", "--disable-gpu", wanted,
        f"--window-size={SIZE_PX[0]},{SIZE_PX[1]}", f"--virtual-time-budget={SETTLED_MS}",
        *(["--no-sandbox"] if os.geteuid() == 0 else []),  # Chromium refuses root otherwise
    ]  # fmt: skip
    try:
        done = subprocess.run(
            [browser, *options, url], capture_output=True, text=True, timeout=10 * PATIENCE_S
        )
    except subprocess.TimeoutExpired as error:
        raise InputError(f"{browser} does not come to an end with {url}; open it there") from error
    return done.stdout


if __name__ == "__main__":
    main()
