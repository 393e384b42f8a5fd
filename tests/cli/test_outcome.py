"""The tables shown after a run tell what its summary holds."""

import io
import re
from types import SimpleNamespace

import numpy as np
import pytest

from evac.cli.main import main
from evac.cli.outcome import show_answer, show_results
from evac.cli.screen import show_facts, show_table
from evac.results.answer import Answer

SUMMARY = {
    "keeps_distance": [],
    "title": "A house",
    "ended": "everybody out",
    "people": 5,
    "evacuated": 5,
    "last_out": 9.0,
    "simulated_time": 10.0,
    "steps": 1000,
    "seed": 7,
    "exits": {"door": {"people": 5, "last_out": 9.0, "width": 0.8, "flow": None, "flow_per_metre": None}},
    "stairs": {"main": {"people": 4, "greatest_number": 3, "last_left": 6.0}},
    "contact": {
        "model": "dem",
        "greatest_overlap": 0.0123,
        "mean_overlap": 0.0045,
        "greatest_residual": 2e-4,
        "unconverged_steps": 6,
        "steps": 1000,
        "contacts": 900,
        "too_fast_steps": 1,
        "too_stiff_steps": 2,
        "wall_crossings_prevented": 4,
        "passes_prevented": 8,
        "greatest_speed": 3.0,
        "energy": {"driving_work": 100.0, "contact_dissipation": 30.0, "contact_creation": 5.0},
    },
    "wall_time": {"physics": 1.5, "recording": 0.5},
    "left_by_other_exits": 0,
    "stuck": [],
    "not_started": 0,
}


@pytest.fixture
def shown(capsys):
    """Show a summary; return its lines, divided at two spaces or more, and what is said on standard error."""

    def show(closed=(), start_time=(0.0, 0.0), **changes):
        results = SimpleNamespace(
            summary=lambda: SUMMARY | changes,
            crowd=SimpleNamespace(level=np.array([-1, 0]), start_time=np.array(start_time)),
            building=SimpleNamespace(
                levels=[SimpleNamespace(name="room")],
                exits=[SimpleNamespace(name="door")],
                label_of=lambda way: f"{way.name} (closed)" if way.name in closed else way.name,
            ),
            answer=SimpleNamespace(movement="People keep distances (mine)"),
            leaving=range(5),
            changes=(),
        )
        show_results(results)
        out, err = capsys.readouterr()
        return [re.split(r"\s{2,}", line.strip()) for line in out.splitlines()], err

    return show


def test_contact_is_told_in_millimetres_and_joules(shown):
    lines, _ = shown()
    first = next(k for k, line in enumerate(lines) if line[0] == "contact model")
    assert lines[first : first + 10] == [
        ["contact model", "dem"],
        ["maximum overlap", "12.3 mm"],
        ["mean overlap", "4.5 mm"],
        ["maximum residual", "0.0002 m/s"],
        ["unconverged steps", "6 of 1000"],
        ["steps cut into smaller ones", "stiff contacts 2, fast people 1, walls 4, people passing each other 8"],
        ["work of driving", "100 J"],
        ["dissipated in contacts", "30 J"],
        ["created in contacts", "5 J"],
        ["balance: carried out or still in motion", "75 J"],
    ]


def test_places_and_phases_stand_under_their_heads(shown):
    lines, _ = shown()
    for head, row in (
        (
            ["exit", "people", "last out [s]", "width [m]", "flow [1/s]", "per metre [1/s/m]"],
            ["door", "5", "9", "0.8", "-", "-"],
        ),
        (["stair", "people", "maximum number", "last left [s]"], ["main", "4", "3", "6"]),
        (["phase", "s"], ["physics", "1.5"]),
    ):
        assert lines[lines.index(head) + 2] == row
    assert ["all", "2"] in lines


def test_with_people_left_the_last_time_is_that_of_those_who_are_out(shown):
    assert ["last out", "9.00 s"] in shown()[0]
    lines, _ = shown(evacuated=4, ended="no progress")
    assert ["last out", "9.00 s, the last of those who are out; people left: 1"] in lines


def test_a_closed_exit_is_marked(shown):
    assert ["door (closed)", "5", "9", "0.8", "-", "-"] in shown(closed=["door"])[0]


def test_response_times_are_stated(shown):
    assert ["response times", "none: everybody starts at 0 s"] in shown()[0]
    assert ["response times", "0 to 12.5 s"] in shown(start_time=(0.0, 12.5))[0]


class Terminal(io.StringIO):
    """A terminal of 80 columns."""

    encoding = "utf-8"

    def isatty(self):
        return True


def screen_of(stream):
    """Lines of a screen, without their style."""
    return [re.sub("\x1b[^m]*m", "", line) for line in stream.getvalue().splitlines()]


@pytest.mark.parametrize("remarks", [0, 1, 4])
@pytest.mark.parametrize(("columns", "below"), [(60, 2), (80, 1), (80, 2)])
def test_the_answer_has_a_dozen_lines_at_most(monkeypatch, remarks, columns, below):
    words = "people who did not leave as their route says, in a sentence of more than a line of the terminal " * 2
    answer = Answer(
        verdict="NOT everybody is out after 60.00 s (no progress): 7 of 9 people out",
        times="Last out after 40.00 s; fewer than 95 % got out",
        exits=(
            "Exit 'a': 4 people, the last after 40.00 s",
            "Exit 'b': 2 people",
            "Exit 'c': 1 person",
            "3 other exits",
        ),
        queue=f"Longest queue, before exit 'a': {words}",
        movement="People keep distances (walking)",
        remarks=(words,) * remarks,
        warnings="2 quality warnings (flow higher than measured)",
    )
    screen = Terminal()
    monkeypatch.setattr("sys.stdout", screen)
    monkeypatch.setenv("COLUMNS", str(columns))
    show_answer(SimpleNamespace(answer=answer, title="A title " * 20, source="case.toml", changes=()), below)
    lines = screen_of(screen)
    assert 8 <= len(lines) <= 12 - below  # as many more for the result folder
    assert max(map(len, lines)) <= columns
    assert answer.verdict in " ".join(line.strip() for line in lines)
    assert lines[-1].startswith(answer.warnings)
    assert sum("Exit" in line or "exits" in line for line in lines) >= 4


def test_no_number_of_the_answer_is_cut_off_on_a_narrow_terminal(monkeypatch):
    answer = Answer(
        verdict="NOT everybody is out after 1160.00 s (no progress): 7 of 9 people out",
        times="Evacuation time 1132.13 s; 95 % are out after 1110.53 s",
        exits=("Exit 'main entrance': 485 people by 1132.13 s, 1.47/s (0.73/s/m)",),
        queue="",
        movement="People keep distances (walking)",
        remarks=(),
        warnings="2 quality warnings (flow higher than measured), 3 warnings about building and people",
    )
    for columns in (60, 80):
        screen = Terminal()
        monkeypatch.setattr("sys.stdout", screen)
        monkeypatch.setenv("COLUMNS", str(columns))
        show_answer(SimpleNamespace(answer=answer, title="A title", source="case.toml", changes=()))
        lines = screen_of(screen)
        assert max(map(len, lines)) <= columns
        words = " ".join(" ".join(lines).split())
        assert all(line in words for line in (answer.verdict, answer.times, *answer.exits))


@pytest.mark.parametrize("columns", [56, 60, 80])
def test_tables_are_narrowed_until_they_fit_and_lose_nothing(monkeypatch, columns):
    rows = [
        ("lower flight z=0.00..1.65", "flight", "0.00 to 1.65", 4.2, 30.5, 2),
        ("a storey with a long name", "floor", "0.00", 162.5, 0, 125),
    ]
    screen = Terminal()
    monkeypatch.setattr("sys.stdout", screen)
    monkeypatch.setenv("COLUMNS", str(columns))
    show_table("Levels", ("level", "kind", "z [m]", "plan [m2]", "slope [deg]", "walls"), rows)
    lines = screen_of(screen)
    assert max(map(len, lines)) <= columns
    words = " ".join(lines).split()
    assert {"lower", "z=0.00..1.65", "storey", "flight", "162.5", "30.5", "125", "walls", "1.65"} <= {*words}


def test_facts_are_divided_between_words_and_paths_are_not(monkeypatch):
    path = "/a/folder/with/a/name/that/is/wider/than/the/terminal.msh"
    screen = Terminal()
    monkeypatch.setattr("sys.stdout", screen)
    monkeypatch.setenv("COLUMNS", "40")
    show_facts({"case": "some words " * 6, "building": path})
    lines = screen_of(screen)
    assert path in [line.strip() for line in lines]
    assert all(
        len(line) <= 40 and line.startswith(("case ", 10 * " ", "building")) for line in lines if path not in line
    )


@pytest.mark.parametrize("words", [["plugins", "walking"], ["verify"], ["verify", "--help"], ["plugins", "--verbose"]])
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
