"""The progress display."""

import io
from types import SimpleNamespace

import pytest

from evac.base import display as progress
from evac.base.display import Display, numbers_of
from evac.base.progress import reading, track
from evac.simulation.simulation import Progress


@pytest.mark.parametrize(
    ("state", "wall", "words"),
    [
        # nobody is out: at most the 90 s that are left of the duration, at 10 times real time
        (Progress(10.0, 100.0, 50, 0), 1.0, "0/50 out, t = 10.0 s, 10 x real time, ETA < 0:09"),
        # 25 of 50 out in 2 s: 2 s more
        (Progress(10.0, 1000.0, 50, 25), 2.0, "25/50 out, t = 10.0 s, 5 x real time, ETA 0:02"),
        # 1 of 50 out in 2 s would be 98 s more, but the duration ends after 18 s
        (Progress(10.0, 100.0, 50, 1), 2.0, "1/50 out, t = 10.0 s, 5 x real time, ETA 0:18"),
        (Progress(10.0, 100.0, 50, 50), 100.0, "50/50 out, t = 10.0 s, writing the results"),
        (Progress(100.0, 100.0, 50, 3), 100.0, "3/50 out, t = 100.0 s, writing the results"),
    ],
)
def test_numbers(state, wall, words):
    assert numbers_of(Progress(0.0, state.duration, 50, 0), state, wall) == words


def test_plain_lines_come_now_and_then(monkeypatch, capsys):
    clock = iter([0.0, 40.0, 41.5, 43.0, 48.0, 53.5])  # the first tick compiles
    monkeypatch.setattr(progress.time, "perf_counter", lambda: next(clock))
    with Display() as display:
        display.phase("running")
        for tick in range(1, 6):
            display(Progress(float(tick), 100.0, 5, tick))
    lines = capsys.readouterr().err.splitlines()
    assert [line.partition(",")[0] for line in lines] == ["3/5 out", "5/5 out"]


def test_a_terminal_gets_a_bar(monkeypatch):
    class Terminal(io.StringIO):
        def isatty(self) -> bool:
            return True

    screen = Terminal()
    monkeypatch.setattr("sys.stderr", screen)
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setattr(progress, "BAR_EVERY", 0.0)
    with Display() as display:
        display.phase("reading the [case]")
        display(Progress(1.0, 100.0, 8, 0))
        display(Progress(3.0, 100.0, 8, 2))
    with Display() as display:
        display.phase("reading again")
        assert [*track("opening doors", "abc", 3)] == [*"abc"]
    assert "reading the [case]" in screen.getvalue()
    assert "reading again" in screen.getvalue()
    assert "opening doors" not in screen.getvalue()  # which was over at once
    with Display() as display:
        display.compiling(3, 9)
    assert "3/9, ETA 0:0" in screen.getvalue()
    assert "2/8 out, t = 3.0 s" in screen.getvalue()


def test_loops_tell_how_far_they_are(monkeypatch, capsys):
    clock = iter([0.0, *(10.0 * k for k in range(1, 10))])
    monkeypatch.setattr(
        progress, "time", SimpleNamespace(perf_counter=lambda: next(clock))
    )  # not that of other threads
    assert [*track("drawing", "abcd", 4)] == [*"abcd"]
    with Display():
        assert [*track("drawing", "abcd", 4)] == [*"abcd"]
    with Display():
        reading(1)
        reading(2)
    *lines, last = capsys.readouterr().err.splitlines()
    assert last == "reading the building: 2/3, ETA 0:05"
    assert lines == [f"drawing: {k}/4, ETA 0:{10 * (4 - k):02d}" for k in (1, 2, 3)]


def test_a_file_is_no_terminal_whatever_variables_say(monkeypatch, capsys):
    monkeypatch.setenv("FORCE_COLOR", "1")
    with Display() as display:
        display.phase("reading")
        display.compiling(0, 3)
    said = capsys.readouterr().err
    assert "compiling 3 kernels" in said
    assert "\x1b" not in said
