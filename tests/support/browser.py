"""Checks of HTML pages in a headless Chromium, by the DevTools protocol."""

import json
import re
import shutil
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from websockets.sync.client import ClientConnection, connect

NAMES = ("chromium", "chromium-browser", "google-chrome")
FOUND = next(filter(None, map(shutil.which, NAMES)), None)
FLAGS = (
    "--headless=new",
    "--no-sandbox",
    "--disable-gpu",
    "--hide-scrollbars",
    "--disable-dev-shm-usage",
    "--no-first-run",
    "--disable-background-networking",
    "--remote-debugging-port=0",
)
AUDIT = (Path(__file__).parent / "page_audit.js").read_text(encoding="utf-8")


@dataclass(frozen=True)
class Look:
    """Display of a page: window `width` [px], and colour `scheme` light or dark."""

    width: int
    scheme: str


LOOKS = [Look(width, scheme) for width in (390, 1280) for scheme in ("light", "dark")]


class Browser:
    """One tab of a running browser."""

    def __init__(self, socket: ClientConnection) -> None:
        self._socket, self._number = socket, 0
        self.complaints: list[str] = []
        for domain in ("Page", "Runtime", "Log"):
            self.ask(f"{domain}.enable")

    def ask(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Answer to a DevTools command; errors that the page reports are kept."""
        self._number += 1
        message = {"id": self._number, "method": method, "params": parameters}
        self._socket.send(json.dumps(message))
        while True:
            answer = self._listen()
            if answer.get("id") == self._number:
                if "error" in answer:
                    raise RuntimeError(f"{method}: {answer['error']['message']}")
                return answer["result"]

    def _listen(self) -> dict[str, Any]:
        answer: dict[str, Any] = json.loads(self._socket.recv(timeout=60))
        if answer.get("method") == "Runtime.exceptionThrown":
            details = answer["params"]["exceptionDetails"]
            self.complaints.append(
                f"{details['text']}"
                f" {details.get('exception', {}).get('description', '')}"
            )
        entry = answer.get("params", {}).get("entry", {})
        if answer.get("method") == "Log.entryAdded" and entry.get("level") == "error":
            self.complaints.append(f"{entry['text']} {entry.get('url', '')}")
        return answer

    def problems(self, page: Path, look: Look) -> list[str]:
        """Faults of `page`: errors, broken images, overflow, too small or faint
        text.
        """
        self.complaints = []
        size = {
            "width": look.width,
            "height": 900,
            "deviceScaleFactor": 1,
            "mobile": False,
        }
        self.ask("Emulation.setDeviceMetricsOverride", **size)
        media = [{"name": "prefers-color-scheme", "value": look.scheme}]
        self.ask("Emulation.setEmulatedMedia", features=media)
        opened = self.ask("Page.navigate", url=page.resolve().as_uri())
        if "errorText" in opened:
            raise FileNotFoundError(f"{page}: {opened['errorText']}")
        while self._listen().get("method") != "Page.loadEventFired":
            pass
        return [*self.complaints, *self.evaluate(AUDIT)]

    def evaluate(self, expression: str) -> Any:
        """Value of a JavaScript `expression` in the page; RuntimeError where it
        throws.
        """
        wanted = {"expression": expression, "returnByValue": True, "awaitPromise": True}
        found = self.ask("Runtime.evaluate", **wanted)
        if "exceptionDetails" in found:
            raise RuntimeError(found["exceptionDetails"]["exception"]["description"])
        return found["result"].get("value")

    def point(self, x: float, y: float, *kinds: str, **more: Any) -> None:
        """Send mouse events `kinds`, such as mousePressed, at a place of the window
        [px].
        """
        for kind in kinds:
            self.ask("Input.dispatchMouseEvent", type=kind, x=x, y=y, **more)


@contextmanager
def browser() -> Iterator[Browser]:
    """Context with a running browser; RuntimeError where it does not start."""
    with TemporaryDirectory() as place:
        command = [str(FOUND), *FLAGS, f"--user-data-dir={place}", "about:blank"]
        with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process:
            try:
                address = _address(process)
                tabs = address.replace("ws://", "http://").partition("/devtools")[0]
                with connect(_first_tab(tabs), max_size=None, proxy=None) as socket:
                    yield Browser(socket)
            finally:
                process.terminate()


def _address(process: "subprocess.Popen[str]") -> str:
    for line in process.stderr or ():
        if found := re.search(r"ws://\S+", line):
            return found[0]
    raise RuntimeError(f"{FOUND} did not start")


def _first_tab(tabs: str) -> str:
    from urllib.request import urlopen

    with urlopen(f"{tabs}/json/list") as answer:  # noqa: S310  of our own browser
        listed = json.load(answer)
    return next(
        str(tab["webSocketDebuggerUrl"]) for tab in listed if tab["type"] == "page"
    )
