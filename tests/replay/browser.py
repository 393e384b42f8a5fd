"""A headless Chromium, driven by the DevTools protocol over its pipe: JSON messages that end with a zero byte."""

import base64
import fcntl
import json
import os
import shutil
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import matplotlib

#: Software rendering, so that every machine draws the same; pages are put together without it, in half the time.
SWITCHES = (
    "--headless=new",
    "--no-sandbox",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-gpu-compositing",
    "--remote-debugging-pipe",
    "--hide-scrollbars",
    "--no-first-run",
    "--disable-background-networking",
    "--force-device-scale-factor=1",
)
#: DevTools reads from 3 and writes to 4.
HAND_OVER = "import os, sys; [os.dup2(int(sys.argv[k]), k + 2) for k in (1, 2)]; os.execv(sys.argv[3], sys.argv[3:])"

#: Fonts of the machine, and those of matplotlib: a Chromium that finds no font at all ends at every page.
FONTS = (
    '<fontconfig><include ignore_missing="yes">{}</include><dir>{}/fonts/ttf</dir><cachedir>{}</cachedir></fontconfig>'
)

NAMES = ("chromium", "chromium-browser", "google-chrome", "chrome")


def find_chromium():
    """Return the path of an installed Chromium, or None."""
    return next((path for path in map(shutil.which, NAMES) if path), None)


class Browser:
    """One process with one page at a time."""

    def __init__(self, executable, profile: Path) -> None:
        to_browser, self._out = os.pipe()
        self._in, from_browser = os.pipe()
        ends = [fcntl.fcntl(end, fcntl.F_DUPFD, 10) for end in (to_browser, from_browser)]
        machine = os.environ.get("FONTCONFIG_FILE", "/etc/fonts/fonts.conf")
        fonts = profile / "fonts.conf"
        fonts.write_text(FONTS.format(machine, matplotlib.get_data_path(), profile / "fonts"), encoding="utf-8")
        words = [executable, *SWITCHES, f"--user-data-dir={profile}", "about:blank"]
        self._process = subprocess.Popen(
            [sys.executable, "-S", "-c", HAND_OVER, *map(str, ends), *words],
            pass_fds=ends,
            env={**os.environ, "FONTCONFIG_FILE": str(fonts)},
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        for end in (to_browser, from_browser, *ends):
            os.close(end)
        self._count = 0
        self._rest = b""
        self._session = None
        self.page = None
        self.errors, self.requests = [], []

    def close(self) -> None:
        """End the process."""
        with suppress(OSError, EOFError):
            self._session = None
            self.send("Browser.close")
        self._process.wait(timeout=20)
        os.close(self._in)
        os.close(self._out)

    def open(self, path: Path, width=960, height=600, dark=False):
        """Open a page of the disk and wait until it plays; its errors and requests are noted."""
        if self._session is None:
            target = self.send("Target.createTarget", {"url": "about:blank"})["targetId"]
            self._session = self.send("Target.attachToTarget", {"targetId": target, "flatten": True})["sessionId"]
            for domain in ("Page", "Runtime", "Network", "Log"):
                self.send(f"{domain}.enable")
        self.send("Page.navigate", {"url": "about:blank"})  # the same page is read again, and nothing of it goes on
        self.page = (path, width, height, dark)
        self.errors, self.requests = [], []
        scheme = [{"name": "prefers-color-scheme", "value": "dark" if dark else "light"}]
        self.send("Emulation.setEmulatedMedia", {"features": scheme})
        self.resize(width, height)
        self.send("Page.navigate", {"url": Path(path).resolve().as_uri()})
        self.wait("window.replay || /cannot/.test(document.getElementById('loading')?.textContent)")
        self.settle()

    def show(self, path: Path, width=960, height=600, dark=False):
        """Open a page, or set the one that is open in this way back to how it opens, which is faster."""
        if self.page != (path, width, height, dark):
            self.open(path, width, height, dark)
        self.run("replay.act.restart()")
        self.settle()

    def resize(self, width, height) -> None:
        """Give the page a size [pixels]."""
        metrics = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": False}
        self.send("Emulation.setDeviceMetricsOverride", metrics)

    def run(self, expression):
        """Return what an expression, or the promise that it is, comes to."""
        answer = self.send("Runtime.evaluate", {"expression": expression, "returnByValue": True, "awaitPromise": True})
        assert "exceptionDetails" not in answer, answer["exceptionDetails"]
        return answer["result"].get("value")

    def wait(self, condition, seconds=30) -> None:
        """Wait until an expression is true."""
        tries = f"""new Promise((done) => {{
            const end = performance.now() + {1000 * seconds};
            const look = () => {{
              let found = false;
              try {{ found = Boolean({condition}); }} catch {{ /* not there yet */ }}
              if (found || performance.now() > end) done(found); else setTimeout(look, 20);
            }};
            look();
        }})"""
        assert self.run(tries), f"never true: {condition}"

    def settle(self) -> None:
        """Wait until what has been asked for is drawn."""
        self.run("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(() => setTimeout(done, 0))))")

    def text(self, selector):
        """Return the text of an element as it is shown; nothing where it is hidden."""
        return self.run(f"document.querySelector({selector!r})?.innerText.trim()")

    def press(self, key, code="", text=None, modifiers=0) -> None:
        """Press a key and let it go."""
        values = {"key": key, "code": code, "modifiers": modifiers, "windowsVirtualKeyCode": 27 * (key == "Escape")}
        self.send("Input.dispatchKeyEvent", {"type": "keyDown", **values, **({"text": text} if text else {})})
        self.send("Input.dispatchKeyEvent", {"type": "keyUp", **values})
        self.settle()

    def mouse(self, kind, x, y, buttons=0, **more) -> None:
        """Send one event of the mouse."""
        button = "left" if buttons or kind == "mouseReleased" else "none"
        values = {"type": kind, "x": x, "y": y, "button": button, "buttons": buttons, "clickCount": 1, **more}
        self.send("Input.dispatchMouseEvent", values)

    def click(self, x, y) -> None:
        """Click at a place of the page."""
        self.mouse("mousePressed", x, y, 1)
        self.mouse("mouseReleased", x, y)
        self.settle()

    def picture(self) -> bytes:
        """Return a picture of the page as PNG."""
        return base64.b64decode(self.send("Page.captureScreenshot", {"format": "png"})["data"])

    def saved(self) -> str:
        """Return the address of the picture that the page saves of what is shown, with labels and legend."""
        self.run("HTMLCanvasElement.prototype.toBlob = function () { window.saved = this.toDataURL(); }")
        self.run("document.getElementById('save-picture').click()")
        return self.run("saved")

    def send(self, method, parameters=None):
        """Send a command to the page, or to the browser before one is open, and return its result."""
        self._count += 1
        message = {"id": self._count, "method": method, "params": parameters or {}}
        if self._session is not None:
            message["sessionId"] = self._session
        os.write(self._out, json.dumps(message).encode() + b"\0")
        while True:
            answer = self._receive()
            if answer.get("id") == self._count:
                assert "error" not in answer, f"{method}: {answer['error']}"
                return answer["result"]
            self._note(answer)

    def _note(self, event) -> None:
        method, values = event.get("method"), event.get("params", {})
        if method == "Runtime.exceptionThrown":
            details = values["exceptionDetails"]
            self.errors.append(details.get("exception", {}).get("description") or details["text"])
        elif method == "Log.entryAdded" and values["entry"]["level"] == "error":
            self.errors.append(values["entry"]["text"])
        elif method == "Runtime.consoleAPICalled" and values["type"] in ("error", "warning"):
            self.errors.append(str(values["args"]))
        elif method == "Network.requestWillBeSent":
            self.requests.append(values["request"]["url"])

    def _receive(self):
        while b"\0" not in self._rest:
            data = os.read(self._in, 1 << 20)
            if not data:
                raise EOFError("the browser has ended")
            self._rest += data
        message, _, self._rest = self._rest.partition(b"\0")
        return json.loads(message)
