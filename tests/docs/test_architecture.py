"""Rooms and files are as large as docs/architecture.md says."""

import collections

from tests.docs.conftest import ROOT


def sizes():
    """Return the number of lines of each module of the core and the plugins, by its path."""
    paths = [*(ROOT / "evac").rglob("*.py"), *(ROOT / "plugins").glob("*.py")]
    return {path.relative_to(ROOT): len(path.read_text(encoding="utf-8").splitlines()) for path in paths}


def test_no_room_has_more_than_3000_lines():
    rooms = collections.Counter()
    for path, lines in sizes().items():
        rooms[path.parent.as_posix()] += lines
    for path in (ROOT / "evac/replay/page").rglob("*.*"):
        rooms[path.parent.as_posix()] += len(path.read_text(encoding="utf-8").splitlines())
    del rooms["plugins"]  # which are no room, but equal to those of third parties
    assert {room: lines for room, lines in rooms.items() if lines > 3000} == {}


def test_modules_below_40_lines_are_those_with_a_reason():
    conventions = (ROOT / "docs/architecture.md").read_text(encoding="utf-8").partition("## Conventions")[2]
    short = [path for path, lines in sizes().items() if lines < 40 and path.name != "__init__.py"]
    others = [path for path in short if path.parts[0] != "plugins" and path.parts[:2] != ("evac", "cli")]
    assert [path for path in others if f"`{path.relative_to('evac').as_posix()}`" not in conventions] == []
