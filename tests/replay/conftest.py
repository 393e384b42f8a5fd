"""One browser for all tests of the replay, and pages to open."""

import sys
from pathlib import Path

import pytest

import evac
from evac.replay.writer import replay_trajectory
from evac.trajectory.trajectory import read_trajectory


@pytest.fixture(scope="session")
def chromium(tmp_path_factory):
    """A running browser; .ci/run installs one where there is none, so that nothing is skipped there."""
    if sys.platform == "win32":
        pytest.skip("the browser is driven through pipes that Windows does not hand over")
    monkeypatch = pytest.MonkeyPatch()
    monkeypatch.syspath_prepend(str(Path(__file__).parent))
    from browser import Browser, find_chromium

    executable = find_chromium()
    if executable is None:
        pytest.skip("no Chromium is installed (Debian: apt-get install chromium)")
    browser = Browser(executable, tmp_path_factory.mktemp("profile"))
    yield browser
    browser.close()
    monkeypatch.undo()


@pytest.fixture
def browser(chromium):
    """The browser; what a test does with it must raise no error, and fetch nothing but the page."""
    yield chromium
    assert chromium.errors == []
    kinds = [kind for url in chromium.requests if (kind := url.partition(":")[0]) != "data"]
    assert kinds in ([], ["file"])


@pytest.fixture(scope="session")
def room(tmp_path_factory):
    """Result folder of the square room, and its results."""
    folder = tmp_path_factory.mktemp("room") / "result"
    quiet = {"output.picture": False, "output.animation": False}
    return folder, evac.run(evac.load("square_room", quiet), folder)


@pytest.fixture
def storeys(descent):
    """Page and trajectory of a walk down three storeys, with a frame every 0.5 s."""
    path = descent(people=6, frames=5).path
    trajectory = read_trajectory(path)
    replay_trajectory(trajectory, path.with_name("replay.html"))
    return path.with_name("replay.html"), trajectory
