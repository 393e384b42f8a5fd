"""From a case to a folder: what others put there stays, and a run that fails leaves what it has."""

import json
import os
import signal
import subprocess
import sys
import textwrap
import time
from contextlib import nullcontext, suppress
from functools import partial
from pathlib import Path
from unittest.mock import Mock

import pytest
from matplotlib import rc_context

import evac
import evac.results.results as results_module
from evac.analysis import lines
from evac.base.errors import FolderWarning, PluginError
from evac.folder.resultfolder import ResultFolder
from evac.results.ending import INTERRUPTED, Stopped
from evac.results.results import Results
from evac.simulation.checkpoints import write_checkpoint
from evac.simulation.running import Interrupt, run, run_into
from evac.simulation.simulation import Simulation


def with_plugin(tmp_path, text, changes=()):
    path = tmp_path / "odd.py"
    path.write_text(textwrap.dedent(text), encoding="utf-8")
    return evac.load("square_room", dict(changes), plugin_files=[path])


def test_a_script_is_told_what_the_command_tells(tmp_path):
    late = {"behaviours.response_time": {"time": {"lognormal": [60, 20]}}, "simulation.duration": 1.0}
    case = evac.load("square_room", {"output.picture": False, **late})
    for folder in (None, tmp_path / "r"):
        with pytest.warns(evac.RunWarning) as told:
            results = evac.run(case, folder)
        lines = [str(one.message) for one in told]
        assert lines == [*results.warnings, *results.remarks, *results.quality_warnings]
        assert "20 of them had not started" in lines[-1]
        assert {one.filename for one in told} == {__file__}


def interrupting(at):
    """A progress display that sends this process Ctrl-C, as a terminal or a notebook does."""

    def progress(state):
        if state.time >= at - 1e-9:
            signal.raise_signal(signal.SIGINT)

    return progress


def test_ctrl_c_in_python_leaves_tables_and_a_state(tmp_path):
    handler = signal.signal(signal.SIGINT, signal.default_int_handler)  # ignored where tests run in the background
    try:
        case = evac.load("square_room", {"output.picture": False, "output.animation": False})
        whole = evac.run(case, tmp_path / "whole")
        with pytest.raises(KeyboardInterrupt, match=r"evac\.resume"):
            evac.run(case, tmp_path / "r", progress=interrupting(2.0))
        summary = json.loads((tmp_path / "r" / "summary.json").read_text())
        assert (summary["ended"], summary["simulated_time"]) == (INTERRUPTED, 2.0)
        assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
        resumed = evac.resume(tmp_path / "r")
        assert resumed.crowd.exit_time.tobytes() == whole.crowd.exit_time.tobytes()
    finally:
        signal.signal(signal.SIGINT, handler)


RECORDER = """
    from evac import Recorder, hookimpl
    evac_interface = 3

    class Odd(Recorder):
        '''Fails.'''
        name = "odd"

        def {method}:
            raise ValueError("oops")
        {more}

    @hookimpl
    def evac_recorders():
        return [Odd]
"""


@pytest.mark.parametrize(
    ("method", "more", "words"),
    [
        ("record(self, simulation)", "", r"t = 0\.000 s: recorder 'odd': ValueError: oops"),
        (
            "finish(self, simulation, results)",
            "def record(self, simulation): pass",
            r"recorder 'odd': finish: ValueError: oops",
        ),
    ],
    ids=["record", "finish"],
)
def test_a_recorder_that_fails_is_named(tmp_path, method, more, words):
    case = with_plugin(tmp_path, RECORDER.format(method=method, more=more), {"simulation.duration": 0.5})
    with pytest.raises(PluginError, match=words):
        run(case, tmp_path / "r")
    if "finish" in method:
        summary = json.loads((tmp_path / "r" / "summary.json").read_text())
        assert summary["ended"] == "duration over"
        assert (tmp_path / "r" / "people.csv").is_file()


def test_a_run_that_fails_leaves_its_tables(tmp_path):
    case = with_plugin(
        tmp_path,
        """
        from evac import Behaviour, hookimpl
        evac_interface = 3

        class Odd(Behaviour):
            '''Fails late.'''
            name = "odd"

            def act(self, crowd, time):
                if time > 1.0:
                    raise ValueError("oops")

        @hookimpl
        def evac_behaviours():
            return [Odd]
        """,
        {"behaviours.odd": {}},
    )
    with pytest.raises(PluginError, match="oops"):
        run(case, tmp_path / "r")
    summary = json.loads((tmp_path / "r" / "summary.json").read_text())
    assert summary["ended"] == "failed"
    assert summary["simulated_time"] == pytest.approx(1.1)


def test_evac_finish_sees_how_it_ended_and_is_named_where_it_fails(tmp_path):
    text = """
        from evac import hookimpl
        evac_interface = 3

        @hookimpl
        def evac_finish(results, error):
            raise KeyError(results.ended if error is None else type(error).__name__)
    """
    case = with_plugin(tmp_path, text, {"simulation.duration": 0.5})
    with pytest.raises(PluginError, match=r"odd\.py: evac_finish: KeyError: 'duration over'"):
        Simulation(case).run()


def test_a_stop_after_the_last_tick_leaves_how_it_ended():
    def stop(progress):
        if progress.out == progress.people:
            raise Stopped

    assert Simulation(evac.load("square_room")).run(stop).ended == "everybody out"


def test_the_order_of_the_tables_of_groups_changes_nothing(tmp_path):
    """The school for 12 s: the same people with the same times at the same places, in the same rows."""
    quiet = {f"output.{name}": False for name in ("picture", "animation", "replay")}
    short = {"simulation.duration": 12.0, "behaviours.headway": {}, "directions.spacing": 0.2}
    case = evac.load("primary_school", quiet | short)
    other = case.change({"people": case.to_dict()["people"][::-1]})
    for one, folder in ((case, "one"), (other, "other")):
        assert run(one, tmp_path / folder).evacuated > 0
    for name in ("people.csv", "egress.csv", "trajectory.evac"):
        assert (tmp_path / "one" / name).read_bytes() == (tmp_path / "other" / name).read_bytes(), name


def test_the_phases_of_a_run_add_up_to_its_wall_time(tmp_path, monkeypatch):
    """All but taking the folder and putting it in its place; the best of three runs, with every output."""
    case = evac.load("square_room")
    run(case, tmp_path / "first")  # loads kernels and packages
    written_at = []
    write = Results.write_summary

    def noting(results, folder):
        written_at.append(time.perf_counter())
        write(results, folder)

    monkeypatch.setattr(Results, "write_summary", noting)
    shares = []
    for name in "abc":  # a process that waits for a processor between two phases adds to one run
        start = time.perf_counter()
        results = run(case, tmp_path / name)
        shares.append(sum(results.phases.values()) / (written_at[-1] - start))
        written = json.loads((tmp_path / name / "summary.json").read_text(encoding="utf-8"))["wall_time"]
        assert written == results.phases
    assert 0.95 < max(shares) <= 1.0


@pytest.mark.parametrize("duration", [0.5, 5.0])
def test_whoever_shows_a_run_is_told_once_that_outputs_are_written_unless_it_failed(tmp_path, duration):
    more = "@hookimpl\ndef evac_behaviours(): return [Late]\n"
    late = "class Late(Behaviour):\n  name = 'late'\n  def act(self, crowd, time):\n    if time > 1.0: raise KeyError\n"
    text = f"from evac import Behaviour, hookimpl\nevac_interface = 3\n{late}{more}"
    case = with_plugin(tmp_path, text, {"behaviours.late": {}, "simulation.duration": duration})
    told = []
    with ResultFolder(tmp_path / "r") as place:
        simulation = Simulation(case, place.running)
        place.start()
        with suppress(PluginError) if duration > 1.0 else nullcontext():
            run_into(simulation, place, None, Interrupt(), None, lambda: told.append(place.path.exists()))
    assert told == ([] if duration > 1.0 else [True])  # with what is in place already


def test_every_file_of_a_run_is_written_once(tmp_path, monkeypatch):
    replaced = []
    real = os.replace
    monkeypatch.setattr("os.replace", lambda new, path: replaced.append(str(path)) or real(new, path))
    results = run(evac.load("square_room", {"simulation.duration": 0.5}), tmp_path / "r")
    assert results.number_of_people == 20
    written = [
        str(path) for path in (tmp_path / "r").rglob("*.*") if path.name not in ("trajectory.evac", "manifest.jsonl")
    ]
    assert {"summary.json", "people.csv", "egress.png", "building.vtm"} <= {Path(path).name for path in written}
    assert sorted(name.replace("r.running", "r") for name in replaced) == sorted(written)


def test_queues_and_flows_are_found_once_for_replay_tables_and_summary(tmp_path, monkeypatch):
    found = []

    def counted(make, *given):
        found.append(make.__name__)
        return make(*given)

    for name, owner in (("find_queues", results_module), ("line_flows", lines)):
        monkeypatch.setattr(owner, name, partial(counted, getattr(owner, name)))
    results = run(evac.load("square_room", {"output.picture": False, "simulation.duration": 2.0}), tmp_path / "r")
    assert results.flows
    assert isinstance(results.queues, tuple)
    assert found == ["line_flows", "find_queues"]
    assert results.trajectory.path.parent == tmp_path / "r"


@pytest.mark.parametrize("raised", [ValueError("no picture"), KeyboardInterrupt()])
def test_a_picture_that_fails_or_is_interrupted_leaves_the_result_in_its_place(tmp_path, monkeypatch, raised):
    case = evac.load("square_room", {"simulation.duration": 0.1})
    run(case, tmp_path / "r")
    monkeypatch.setattr("evac.pictures.writing.save", Mock(side_effect=raised))
    is_warned = isinstance(raised, ValueError)
    with (
        pytest.warns(FolderWarning, match=r"egress\.png: ValueError: no picture")
        if is_warned
        else pytest.raises(KeyboardInterrupt)
    ):
        run(case.change({"simulation.seed": 5}), tmp_path / "r")
    assert json.loads((tmp_path / "r" / "summary.json").read_text())["seed"] == 5
    assert not (tmp_path / "r.running").exists()


def test_a_plugin_that_fails_when_the_run_has_ended_leaves_the_result_in_its_place(tmp_path):
    case = evac.load("square_room", {"simulation.duration": 0.1})
    run(case, tmp_path / "r")
    text = """
        from evac import hookimpl
        evac_interface = 3

        @hookimpl
        def evac_finish(simulation, results, error):
            raise ValueError("at the end")
    """
    with pytest.raises(PluginError, match="at the end") as caught:
        run(with_plugin(tmp_path, text, {"simulation.duration": 0.1, "simulation.seed": 5}), tmp_path / "r")
    assert any(str(tmp_path / "r") in note for note in caught.value.__notes__)
    assert json.loads((tmp_path / "r" / "summary.json").read_text())["seed"] == 5
    assert not (tmp_path / "r.running").exists()


SLOW_PAGE = """
    import signal, sys, time
    from evac import Recorder, hookimpl
    evac_interface = 3

    class Late(Recorder):
        '''Tells that outputs are being written, then takes long.'''
        name = "late"

        def record(self, simulation):
            '''Do nothing.'''

        def finish(self, simulation, results):
            '''Wait for Ctrl-C.'''
            print("finishing", flush=True)
            time.sleep(60.0)

    @hookimpl
    def evac_recorders():
        return [Late]
"""


@pytest.mark.skipif(os.name == "nt", reason="Windows has no SIGINT to send")
def test_a_second_ctrl_c_while_outputs_are_written_publishes_what_is_complete(tmp_path):
    (tmp_path / "late.py").write_text(textwrap.dedent(SLOW_PAGE))
    words = [sys.executable, "-m", "evac", "run", "square_room", "--out", "r", "--plugin", "late.py"]
    words += ["--set", "people.people.number=2", "output.animation=false"]
    heeding = partial(signal.signal, signal.SIGINT, signal.SIG_DFL)  # a shell lets background jobs ignore it
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    process = subprocess.Popen(words, cwd=tmp_path, preexec_fn=heeding, **pipes)
    while "finishing" not in (line := process.stdout.readline()):
        assert line, process.communicate()
    process.send_signal(signal.SIGINT)
    assert any("Ctrl-C again" in line for line in process.stderr)
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=60)
    assert process.returncode == 130
    assert "Traceback" not in err
    assert not (tmp_path / "r.running").exists()
    results = evac.read_results(tmp_path / "r")
    assert (results.ended, results.evacuated) == ("everybody out", 2)
    assert results.trajectory.time[-1] == pytest.approx(results.time)
    assert "without replay.html, egress.png" in err


@pytest.fixture
def heeded():
    """Have Ctrl-C raise an error, which background jobs of a shell ignore."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.parametrize(("signals", "breaks"), [(1, False), (2, False), (2, True), (3, False)])
@pytest.mark.usefixtures("heeded")
def test_signals_are_counted_and_the_third_or_one_that_may_break_raises(signals, breaks):
    with Interrupt() as interrupt, pytest.raises(KeyboardInterrupt) if signals == 3 or breaks else nullcontext():
        interrupt.may_break = breaks
        for _ in range(signals):
            signal.raise_signal(signal.SIGINT)
    assert (interrupt.count, interrupt.wanted) == (signals, signal.SIGINT)
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


@pytest.mark.usefixtures("heeded")
def test_what_a_command_tells_of_an_interrupt_is_not_interrupted():
    with pytest.raises(KeyboardInterrupt), Interrupt(announce=Mock()):
        raise KeyboardInterrupt
    signal.raise_signal(signal.SIGINT)


@pytest.mark.usefixtures("heeded")
def test_a_signal_while_outputs_are_written_leaves_out_the_rest_and_names_it(tmp_path, monkeypatch):
    save = Mock(side_effect=lambda *_: signal.raise_signal(signal.SIGINT))
    monkeypatch.setattr("evac.pictures.writing.save", save)
    case = evac.load("square_room", {"simulation.duration": 0.1, "output.animation": True, "output.replay": False})
    with pytest.raises(KeyboardInterrupt) as caught:
        run(case, tmp_path / "r")
    assert "without egress.png, animation.pvd" in caught.value.__notes__[0]
    assert evac.read_results(tmp_path / "r").number_of_people == 20


@pytest.mark.usefixtures("heeded")
def test_a_second_ctrl_c_while_the_state_is_saved_leaves_out_pictures_alone(tmp_path, monkeypatch):
    def saved(*given):
        signal.raise_signal(signal.SIGINT)
        return write_checkpoint(*given)

    monkeypatch.setattr("evac.simulation.checkpoints.write_checkpoint", saved)
    with pytest.raises(KeyboardInterrupt) as caught:
        run("square_room", tmp_path / "r", progress=lambda _: signal.raise_signal(signal.SIGINT))
    assert caught.value.__notes__[0].endswith("without egress.png, animation.pvd")
    results = evac.read_results(tmp_path / "r")
    assert (results.ended, results.time) == (INTERRUPTED, results.case.simulation.tick)
    monkeypatch.undo()
    assert evac.resume(tmp_path / "r").ended == "everybody out"


def test_settings_of_matplotlib_do_not_steer_the_pictures_of_runs(tmp_path):
    case = evac.load("square_room", {"simulation.duration": 0.1, "output.replay": False, "output.animation": False})
    for name, settings in (("plain", {}), ("steered", {"savefig.dpi": 20, "font.size": 40, "axes.facecolor": "red"})):
        with rc_context(settings):
            run(case, tmp_path / name / "run")
            evac.repeat(case, 2, folder=tmp_path / name / "study", workers=1)
    pictures = [path.relative_to(tmp_path / "plain") for path in (tmp_path / "plain").rglob("*.png")]
    assert sorted(str(picture.parent) for picture in pictures) == ["run", "study"]
    for picture in pictures:
        assert (tmp_path / "plain" / picture).read_bytes() == (tmp_path / "steered" / picture).read_bytes()
