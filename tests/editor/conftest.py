"""A case to edit, a server that serves it, and the browser of the tests of the replay."""

import importlib.util
import shutil
import sys
import threading
import time
from pathlib import Path
from types import SimpleNamespace

import pytest

from evac.base.processes import Pool
from evac.cli.main import main
from evac.editor import Server, Session

REPLAY = Path(__file__).parents[1] / "replay"


@pytest.fixture(scope="session")
def judging():
    """A process that judges the plans of all sessions, because it takes long to start."""
    with Pool(1, is_quiet=True) as pool:
        yield pool


@pytest.fixture(autouse=True)
def one_process(judging, monkeypatch):
    """Let sessions use this process, which none of them ends."""
    shared = SimpleNamespace(submit=judging.submit, kill=lambda: None)
    monkeypatch.setattr("evac.editor.session.Pool", lambda workers, is_quiet: shared)


@pytest.fixture
def house(tmp_path):
    """The example of `evac new`."""
    main(["new", str(tmp_path / "house")])
    return tmp_path / "house"


@pytest.fixture
def fire(tmp_path):
    """A case that holds its plan."""
    shutil.copytree(Path(__file__).parents[2] / "buildings/office_fire", tmp_path / "fire")
    return tmp_path / "fire"


@pytest.fixture
def eventually():
    """A function that waits until something is so."""

    def waiting(is_so, seconds=120):
        end = time.monotonic() + seconds
        while not is_so():
            assert time.monotonic() < end
            time.sleep(0.05)

    return waiting


@pytest.fixture
def serve():
    """A function that serves a plan, or what asks for one."""
    servers = []

    def serving(path, **options):
        server = Server(path and Session(path), **options)
        threading.Thread(target=server.serve, args=(False,), daemon=True).start()
        servers.append(server)
        return server

    yield serving
    for server in servers:
        server.shutdown()
        server.server_close()


@pytest.fixture(scope="session")
def browser(tmp_path_factory):
    """A browser with a page at an address."""
    spec = importlib.util.spec_from_file_location("browser", REPLAY / "browser.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    executable = module.find_chromium()
    if sys.platform == "win32" or executable is None:
        pytest.skip("no Chromium is installed (Debian: apt-get install chromium), or none can be driven here")
    browser = module.Browser(executable, tmp_path_factory.mktemp("profile"))
    yield browser
    browser.close()
