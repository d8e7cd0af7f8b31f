"""A browser without a window, driven by Chromium's DevTools protocol."""

import asyncio
import base64
import json
import os
import shutil
import subprocess
import tempfile
import time
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any
from urllib.request import urlopen

from tornado.websocket import WebSocketClientConnection, websocket_connect

from shaftpose.errors import InputError

BROWSERS = ("chromium", "chromium-browser", "google-chrome")
PATIENCE_S = 60.0
_PAUSE_S = 0.2
_LONGEST_ANSWER = 2**28  # a picture comes as one message
_PORT_FILE = "DevToolsActivePort"


class Page:
    """The one page of a browser; see `open_page`."""

    def __init__(self, socket: WebSocketClientConnection) -> None:
        self._socket, self._calls = socket, 0

    async def show(self, url: str) -> None:
        """Go to an address; what is there may come later."""
        await self._call("Page.navigate", url=url)

    async def run(self, script: str) -> Any:
        """The value of a JavaScript expression. Raises InputError if it fails."""
        answer = await self._call("Runtime.evaluate", expression=script, returnByValue=True)
        if "exceptionDetails" in answer:
            raise InputError(f"{script}: {answer['exceptionDetails']['text']} in this page")
        return answer["result"].get("value")

    async def wait_until(self, condition: str) -> None:
        """Wait for a JavaScript expression to hold. Raises InputError if it does not in time."""
        end = time.monotonic() + PATIENCE_S
        while not await self.run(condition):
            if time.monotonic() > end:
                raise InputError(f"{condition}: does not come true in this page; open it to see")
            await asyncio.sleep(_PAUSE_S)

    async def take_picture(self, path: Path) -> None:
        """Write what is in view as a PNG file."""
        answer = await self._call("Page.captureScreenshot", format="png")
        path.write_bytes(base64.b64decode(answer["data"]))

    async def _call(self, method: str, **parameters: Any) -> dict[str, Any]:
        self._calls += 1
        call = {"id": self._calls, "method": method, "params": parameters}
        await self._socket.write_message(json.dumps(call))
        while True:
            message = await self._socket.read_message()
            if message is None:
                raise InputError("the browser has ended; run it again")
            answer = json.loads(message)
            if answer.get("id") == self._calls:  # others tell what happens in the page
                return dict(answer.get("result", {}))


@asynccontextmanager
async def open_page(size_px: tuple[int, int]) -> AsyncIterator[Page]:
    """A page of this width and height in a browser of its own.

    Raises InputError if none is installed or it does not start.
    """
    browser = next(filter(None, map(shutil.which, BROWSERS)), None)
    if browser is None:
        raise InputError(f"none of {', '.join(BROWSERS)} is installed; install one of them")
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        command = [
            browser, "--headless=new", "--hide-scrollbars", "--disable-gpu",
            f"--window-size={size_px[0]},{size_px[1]}", f"--user-data-dir={profile}",
            "--remote-debugging-port=0",  # a free one, of this machine alone
            *(["--no-sandbox"] if os.geteuid() == 0 else []),  # Chromium refuses root otherwise
            "about:blank",
        ]  # fmt: skip
        nowhere = subprocess.DEVNULL
        process = subprocess.Popen(command, stdout=nowhere, stderr=nowhere)
        try:
            yield Page(await _connect(Path(profile) / _PORT_FILE, browser))
        finally:
            process.terminate()
            process.wait()


async def _connect(port_file: Path, browser: str) -> WebSocketClientConnection:
    lines = await _eventually(lambda: port_file.read_text().splitlines(), browser)
    address = f"http://127.0.0.1:{lines[0]}/json"
    pages = await _eventually(lambda: [p for p in _known(address) if p["type"] == "page"], browser)
    url = pages[0]["webSocketDebuggerUrl"]
    return await websocket_connect(url, max_message_size=_LONGEST_ANSWER)


def _known(address: str) -> list[dict[str, str]]:
    with urlopen(address, timeout=5) as answer:
        return list(json.load(answer))


async def _eventually(look: Callable[[], list[Any]], browser: str) -> list[Any]:
    """What a look yields as soon as there is something to see."""
    end = time.monotonic() + PATIENCE_S
    while time.monotonic() < end:
        try:
            if found := look():
                return found
        except OSError:  # not there yet
            pass
        await asyncio.sleep(_PAUSE_S)
    raise InputError(f"{browser}: does not start; try it by hand")
