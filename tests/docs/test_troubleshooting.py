"""The messages on the page on troubleshooting are those that commands print."""

import io
import re
import warnings
from contextlib import redirect_stderr, redirect_stdout

import pytest

from evac.cli.main import main
from evac.folder.resultfolder import locked
from tests.docs.conftest import ROOT

#: Rows whose messages need another environment.
ELSEWHERE = ("skfmm", "numba", "which is not installed")

PAGE = (ROOT / "docs/troubleshooting.md").read_text(encoding="utf-8")
ROWS = [row for row in re.findall(r"^\| (`.+?) \|", PAGE, re.MULTILINE) if not any(word in row for word in ELSEWHERE)]

FILES = {
    "text.toml": 'title = "x"\n[[people]]\nname = "a"\nnumber = ten\n',
    "cut.dxf": "junk",
    "room.wkt": "POLYGON ((0 0, 9 0, 9 6, 0 6, 0 0))",
    "mine/file.txt": "mine",
    "broken.py": "x = ",
    "empty.py": "x = 1",
}

COMMANDS = (
    "run atlantis",
    "run square_room --set simulation.duraton=3",
    "run text.toml",
    "run square_room --set simulation.duration=long",
    "check square_room --set people.people.area=rom",
    "run room.wkt",
    "import cut.dxf --out cut",
    "check square_room --set people.people.number=900",
    "check house --set building.closed=['main','side']",
    "run room",
    "run square_room --set simulation.duration=1 --out short",
    "run square_room --set output.trajectory=false output.animation=false --out bare",
    "run square_room --out mine",
    "run square_room --out locked",
    "render bare",
    "repeat square_room --runs 2 --out first",
    "repeat square_room --runs 2 --seed 9 --out second",
    "compare first second",
    "repeat square_room --runs 3 --resume --set simulation.step=0.005 --out first",
    "run square_room --plugin broken.py",
    "run square_room --plugin empty.py",
)


@pytest.fixture(scope="module")
def said(tmp_path_factory):
    """Return all that the commands print."""
    folder = tmp_path_factory.mktemp("trouble")
    for name, text in FILES.items():
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text(text, encoding="utf-8")
    with pytest.MonkeyPatch.context() as patch, warnings.catch_warnings():
        patch.chdir(folder)
        patch.setenv("COLUMNS", "1000")
        printed = io.StringIO()
        with redirect_stdout(printed), redirect_stderr(printed), locked(folder / "locked.lock", "locked"):
            for words in ("new house", "import room.wkt --out room", *COMMANDS):
                main(words.split())
    return printed.getvalue()


@pytest.mark.parametrize("row", ROWS)
def test_messages_are_those_of_commands(row, said):
    for message in re.findall("`(.+?)`", row):
        assert re.search(re.escape(message).replace(r"\.\.\.", ".*"), said), message


def test_the_page_has_twenty():
    assert len(ROWS) + len(ELSEWHERE) == 20
