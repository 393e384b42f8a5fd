"""The tables shown after a run tell what its summary holds."""

import io
import re
from types import SimpleNamespace

import pytest

from evac.cli.main import main
from evac.cli.run import folder_line, show_answer
from evac.cli.screen import show_table
from evac.folder.files import COMPLETE, mark, note_written
from evac.results.verdict import Answer


class Terminal(io.StringIO):
    """A terminal of 80 columns."""

    encoding = "utf-8"

    def isatty(self):
        return True


def screen_of(stream):
    """Lines of a screen, without their style."""
    return [re.sub("\x1b[^m]*m", "", line) for line in stream.getvalue().splitlines()]


@pytest.mark.parametrize(("columns", "below", "remarks"), [(60, 2, 0), (60, 2, 4), (80, 1, 1), (80, 2, 4)])
def test_the_answer_has_a_dozen_lines_at_most(monkeypatch, remarks, columns, below):
    words = "people who did not leave as their route says, in a sentence of more than a line of the terminal " * 2
    answer = Answer(
        verdict="NOT in time: 'hall' is not left by everybody, available for 29.8 s (visibility): no margin",
        outcome="NOT everybody is out after 60.00 s (no progress): 7 of 9 people out",
        times="Last out after 40.00 s; fewer than 95 % got out",
        exits=(
            "Exit 'a': 4 people, the last after 40.00 s",
            "Exit 'b': 2 people",
            "Exit 'c': 1 person",
            "3 other exits",
        ),
        queue=f"What holds up most is exit 'a': {words}",
        movement="People keep distances (walking)",
        remarks=tuple(f"{k} {words}" for k in range(remarks)),
        warnings="2 quality warnings (flow higher than measured)",
    )
    screen = Terminal()
    monkeypatch.setattr("sys.stdout", screen)
    monkeypatch.setenv("COLUMNS", str(columns))
    told = {
        "answer": answer,
        "title": "A title " * 20,
        "source": "case.toml",
        "changes": (),
        "verdict": {"status": "red"},
    }
    show_answer(SimpleNamespace(**told), below)
    lines = screen_of(screen)
    assert 8 <= len(lines) <= 12 - below  # as many more for the result folder
    assert max(map(len, lines)) <= columns
    shown = " ".join(line.strip() for line in lines)
    assert shown.startswith(answer.verdict)
    assert answer.outcome in shown
    assert lines[-1].startswith(answer.warnings)
    assert sum("Exit" in line or "exits" in line for line in lines) >= 4


def test_tables_are_narrowed_until_they_fit_and_lose_nothing(monkeypatch):
    rows = [
        ("lower flight z=0.00..1.65", "flight", "0.00 to 1.65", 4.2, 30.5, 2),
        ("a storey with a long name", "floor", "0.00", 162.5, 0, 125),
    ]
    screen = Terminal()
    monkeypatch.setattr("sys.stdout", screen)
    monkeypatch.setenv("COLUMNS", "80")
    show_table("Levels", ("level", "kind", "z [m]", "plan [m2]", "slope [deg]", "walls"), rows)
    lines = screen_of(screen)
    assert max(map(len, lines)) <= 80
    words = " ".join(lines).split()
    assert {"lower", "z=0.00..1.65", "storey", "flight", "162.5", "30.5", "125", "walls", "1.65"} <= {*words}


@pytest.mark.parametrize("words", [["verify"], ["verify", "--help"], ["plugins", "--verbose"]])
def test_descriptions_fit_narrow_terminals(monkeypatch, words):
    screen = Terminal()
    monkeypatch.setattr("sys.stdout", screen)
    monkeypatch.setenv("COLUMNS", "60")
    if words[-1] == "--help":
        with pytest.raises(SystemExit):
            main(words)
    else:
        assert main(words) == 0
    assert max(map(len, screen_of(screen))) <= 60


def test_the_last_line_names_files_of_evac_alone(tmp_path):
    mark(tmp_path, COMPLETE, "r")
    for name in ("replay.html", "animation.pvd"):
        (tmp_path / name).touch()
    note_written([tmp_path / "animation.pvd"])
    assert folder_line(tmp_path) == f"results in  {tmp_path}, animation.pvd (ParaView)"
