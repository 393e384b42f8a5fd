"""The server of the page: it listens on the loopback address only, and answers requests with its secret token only."""

import base64
import html
import json
import queue
import secrets
import sys
import tempfile
import threading
import time
import webbrowser
from collections.abc import Callable, Mapping
from functools import cached_property
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any, Self

from evac.base.errors import EvacError
from evac.building.plan.plan import PLAN, Plan
from evac.building.plan.plantable import plan_of, read_table
from evac.case.case import Case
from evac.editor.session import ChangedOnDiskError, Session, begin, new_folder
from evac.replay.writer import PAGE as REPLAY


class Page:
    """A served page; notebooks show it in a frame where the browser runs on this machine. A context that ends it."""

    def __init__(self, session: Session) -> None:
        self._server = Server(session, is_framed=True)
        threading.Thread(target=self._server.serve_forever, daemon=True).start()

    @property
    def address(self) -> str:
        """Address of the page, for a browser on this machine; another one after "Save as"."""
        return self._server.address

    @property
    def file(self) -> Path:
        """The plan file, or the case that holds the plan."""
        assert self._server.session is not None
        return self._server.session.file

    @property
    def plan(self) -> Plan:
        """The plan as it was saved last.

        Raises
        ------
        BuildingError
            The plan in the file is not valid.
        """
        table = read_table(self.file)
        is_case = not self.file.name.lower().endswith(PLAN)
        return plan_of(table["building"]["plan"] if is_case else table, self.file, self.file.parent)

    def close(self) -> None:
        """End the page; what is not saved is kept in a journal beside the file."""
        self._server.shutdown()
        self._server.server_close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __repr__(self) -> str:
        return f"<evac edit {self.file}: {self.address}>"

    def _repr_html_(self) -> str:
        at = html.escape(self.address)
        style = "width: 100%; height: 46rem; border: 1px solid #888"
        frame = f'<iframe src="{at}" title="evac edit" style="{style}"></iframe>'
        return f'<p><a href="{at}" target="_blank">{html.escape(str(self.file))}</a></p>{frame}'


def edit(source: Plan | Case | str | Path, result: str | Path | None = None) -> Page:
    """Serve a page on which a plan is drawn and its case run, as `evac edit` does, and return at once.

    Parameters
    ----------
    source : Plan, Case, str or Path
        A case whose building is a plan, its folder, a plan file, or a plan, which is written to a temporary folder.
    result : str or Path, optional
        Result folder of runs of the case; by default that of `evac run`.

    Returns
    -------
    Page
        Its address; `Page.plan` is the plan as it was saved last.

    Raises
    ------
    EvacError
        The source is not valid, or its building is not a plan.

    Examples
    --------
    >>> page = evac.edit("house")  # doctest: +SKIP
    >>> page.plan.building().exits, page.close()  # doctest: +SKIP
    """
    if isinstance(source, Plan):
        file = Path(tempfile.mkdtemp()) / f"plan{PLAN}"
        source.write(file)
        source = file
    place, plugins = (source.source, source.loaded_files) if isinstance(source, Case) else (Path(source), ())
    return Page(Session(place, None if result is None else Path(result), plugins))


PAGE = Path(__file__).with_name("page")
#: Modules of the page of the replay that this one is made of, too.
SHARED = (
    *("camera", "cars", "chart", "colours", "controls", "layout", "meshes", "section", "shaders", "stage"),
    *("run/density", "panel"),
)
TYPES = {"html": "text/html", "js": "text/javascript", "css": "text/css", "json": "application/json"}
HEADERS = {
    "Cache-Control": "no-store",
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; "
    "connect-src 'self'; base-uri 'none'; form-action 'none'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cross-Origin-Opener-Policy": "same-origin",
}
#: Files of a result are pages of their own, whose scripts reach nothing else.
SANDBOX = (
    "sandbox allow-scripts allow-downloads; default-src 'none'; script-src 'unsafe-inline'; "
    "style-src 'unsafe-inline'; img-src data: blob:; media-src blob:; font-src data:"
)
#: Greatest size of what a page may send [bytes].
MOST_BYTES = 50_000_000
#: Time between two signs of life to a page, and after which the server ends when no page is open [s].
BEAT, IDLE = 5.0, 120.0


class Server(ThreadingHTTPServer):
    """The page of a session at a random port, with a token in its address; a context that ends it.

    Without a session, the page asks for a case to begin with, which is made in the current folder. If `is_framed`,
    pages of this machine, such as notebooks, may show it in a frame. `told` is called when the page goes on with a copy
    at another address.
    """

    daemon_threads = True

    def __init__(
        self,
        session: Session | None,
        idle: float = IDLE,
        is_framed: bool = False,
        told: Callable[["Server"], None] = lambda server: None,
    ) -> None:
        super().__init__(("127.0.0.1", 0), _Handler)
        self.session, self.idle, self.told = session, idle, told
        self.frames = "http://127.0.0.1:* http://localhost:*" if is_framed else "'none'"
        self.host = f"127.0.0.1:{self.server_port}"
        self.token = secrets.token_urlsafe(24)

    @property
    def address(self) -> str:
        """The address of the page."""
        return f"http://{self.host}/{self.token}/"

    @cached_property
    def files(self) -> dict[str, bytes]:
        """The files of the page by name."""
        own = sorted(PAGE.glob("*.js"), key=lambda path: (path.name == "main.js", path.name))
        scripts = "\n".join(path.read_text("utf-8") for path in [*(REPLAY / f"{one}.js" for one in SHARED), *own])
        styles = [(folder / "style.css").read_text("utf-8") for folder in (REPLAY, PAGE)]
        return {
            "page.html": (PAGE / "page.html").read_bytes(),
            "page.js": f'(() => {{ "use strict";\n{scripts}\n}})();'.encode(),
            "page.css": "\n".join(styles).encode(),
        }

    def serve(self, is_shown: bool) -> None:
        """Show the page in the browser, if wished, and serve it until it was closed for some time, or until Ctrl-C."""
        threading.Thread(target=self._end_when_idle, daemon=True).start()
        with tempfile.TemporaryDirectory() as folder:  # of this user; the address is no argument of a command
            if is_shown:
                way = Path(folder) / "evac-edit.html"
                way.touch(0o600)
                way.write_text(f'<!doctype html><meta http-equiv="refresh" content="0; url={self.address}">')
                webbrowser.open(way.as_uri())
            self.serve_forever()

    def serve_forever(self, poll_interval: float = 0.05) -> None:
        """Serve until `shutdown`, which takes at most this time [s]."""
        super().serve_forever(poll_interval)

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Tell errors, but not that a page was closed before it had its answer."""
        if not isinstance(sys.exception(), OSError):
            super().handle_error(request, client_address)

    def server_close(self) -> None:
        """End the session as well."""
        super().server_close()
        if self.session is not None:
            self.session.close()

    def _end_when_idle(self) -> None:
        last = time.monotonic()
        while time.monotonic() - last < self.idle:
            time.sleep(min(1.0, self.idle / 4))
            is_used = self.session is None or self.session.listeners
            last = time.monotonic() if is_used else last
        self.shutdown()


class _Handler(BaseHTTPRequestHandler):
    server: Server
    protocol_version = "HTTP/1.1"
    server_version, sys_version = "evac", ""

    def log_message(self, format: str, *arguments: Any) -> None:
        """Print nothing: addresses have the token."""

    def do_HEAD(self) -> None:
        """Answer as to GET, without the content."""
        self.do_GET()

    def do_GET(self) -> None:
        """Send a file of the page, the plan, or events."""
        name, session = self._allowed_name(), self.server.session
        if name is None:
            return
        kind, _, what = name.partition("/")
        data: dict[str, Callable[[], dict[str, Any]]] = {"document": lambda: {"begin": True}}
        if session is not None:
            data = {"document": session.document, "forms": session.forms, "pictures": session.pictures.all}
        if name in data:
            self._answer(data[name])
        elif name == "events" and self.command == "GET" and session is not None:
            self._send_events(session)
        elif session is not None and what:
            self._answer(lambda: session.page(kind, what))
        elif (name or "page.html") in self.server.files:
            name = name or "page.html"
            self._send(200, TYPES[name.rpartition(".")[2]], self.server.files[name])
        else:
            self._refuse(404, "there is no such page")

    def do_POST(self) -> None:
        """Judge or save what the page sends."""
        name = self._allowed_name()
        if name is None:
            return
        length = self.headers.get("Content-Length", "")
        if self.headers.get("Content-Type") != "application/json":
            self._refuse(415, "send JSON")
        elif not length.isdecimal() or int(length) > MOST_BYTES:
            self._refuse(413, f"send at most {MOST_BYTES} bytes")
        else:
            self._take(name, self.rfile.read(int(length)))

    def _take(self, name: str, content: bytes) -> None:
        session = self.server.session
        try:
            given = json.loads(content)
            orders: dict[str, Callable[[], Any]] = {"begin": lambda: self._begun(**given)}
            if session is not None:
                orders = {"copy": lambda: self._copied(session, **given)} | session.orders(given)
            self._answer(orders.get(name, lambda: None))
        except (ValueError, KeyError, TypeError, RecursionError):
            self._refuse(400, "this is not what the page sends")

    def _begun(self, folder: str, what: str, name: str = "", content: str = "") -> dict[str, Any]:
        made, told = begin(new_folder(folder), what, name, base64.b64decode(content))
        self.server.session = Session(made)
        return {"told": told}

    def _copied(self, session: Session, folder: str, table: dict[str, Any]) -> dict[str, Any]:
        """Go on with a copy at another address, so that no other page takes it for what it was."""
        self.server.session = Session(session.copied(table, new_folder(folder)), plugins=session.plugins)
        self.server.token = secrets.token_urlsafe(24)
        self.server.told(self.server)
        session.close()
        session.journal.unlink(missing_ok=True)
        return {"address": self.server.address}

    def _allowed_name(self) -> str | None:
        """Return the name of what is asked for, if this is asked by the page; else refuse."""
        host, origin = self.headers.get_all("Host", []), self.headers.get("Origin")
        token, _, name = self.path.removeprefix("/").partition("/")
        is_own = origin == f"http://{self.server.host}" or (origin is None and self.command != "POST")
        is_same = self.headers.get("Sec-Fetch-Site", "none") in ("same-origin", "none")
        as_page = ("document", "iframe") if self.server.frames != "'none'" else ("document",)
        if host != [self.server.host]:
            self._refuse(421, "wrong host")
        elif not is_own or not (is_same or self.headers.get("Sec-Fetch-Dest") in as_page):
            self._refuse(403, "wrong origin")
        elif not secrets.compare_digest(token.encode(), self.server.token.encode()):
            self._refuse(404, "there is no such page; its address is that which evac edit has printed last")
        else:
            return name
        return None

    def _answer(self, work: Any) -> None:
        try:
            done = work()
            if isinstance(done, bytes):
                self._send(200, TYPES["html"], done, {"Content-Security-Policy": SANDBOX})
            elif done is None:
                self._refuse(404, "there is no such page")
            else:
                self._send_json(200, done)
        except ChangedOnDiskError as error:
            self._send_json(409, {"error": str(error)})
        except EvacError as error:
            self._send_json(422, {"error": str(error)})

    def _refuse(self, code: int, text: str) -> None:
        self.close_connection = True  # what was sent is not read
        self._send_json(code, {"error": text})

    def _send_json(self, code: int, data: Any) -> None:
        self._send(code, TYPES["json"], json.dumps(data, allow_nan=False).encode())

    def _send(self, code: int, kind: str, content: bytes, more: Mapping[str, str] | None = None) -> None:
        self._head(code, kind, {"Content-Length": str(len(content)), **(more or {})})
        if self.command != "HEAD":
            self.wfile.write(content)

    def _head(self, code: int, kind: str, more: dict[str, str]) -> None:
        self.send_response(code)
        headers = {"Content-Type": f"{kind}; charset=utf-8"} | HEADERS | more
        headers["Content-Security-Policy"] += f"; frame-ancestors {self.server.frames}"
        for name, value in headers.items():
            self.send_header(name, value)
        if self.close_connection:
            self.send_header("Connection", "close")
        self.end_headers()

    def _send_events(self, session: Session) -> None:
        """Send what is told to the pages, until this one is closed."""
        told = queue.Queue[tuple[str, Any]]()
        self.close_connection = True
        session.listeners.append(told)
        for one in session.told.items():
            told.put(one)
        try:
            self._head(200, "text/event-stream", {})
            while not session.is_over.is_set():
                try:
                    event, data = told.get(timeout=BEAT)
                    self.wfile.write(f"event: {event}\ndata: {json.dumps(data)}\n\n".encode())
                except queue.Empty:
                    self.wfile.write(b": still here\n\n")
                self.wfile.flush()
        except OSError:
            pass  # the page was closed
        finally:
            session.listeners.remove(told)
