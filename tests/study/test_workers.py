"""Worker processes of studies: started by scripts without a guard or with own classes; that die or cannot start."""

import gc
import multiprocessing.process
import subprocess
import sys
import textwrap
import weakref
from concurrent.futures import ThreadPoolExecutor

import pytest

import evac
from evac.base.errors import PluginError, ProcessWarning
from evac.study import execute

SCRIPT = """
import enum, os
print("began")
import evac
from evac.study import execute
execute.JOINING = 0.0  # other processes join for the least work

class Model(str, enum.Enum):
    DEM = "dem"

case = evac.load("square_room", {"people.people.number": 3, "contact.model": Model.DEM}, ["here.py"])
study = evac.repeat(case, 4, folder="study", workers=2)
print(len(os.listdir("made")) > 1)
print(sorted(study.times(0).tolist()))
"""

#: A plugin that leaves a file for each process in which a run is prepared.
TRACE = """
import os, pathlib
from evac import hookimpl
evac_interface = 3

@hookimpl
def evac_prepare(simulation):
    pathlib.Path("made").mkdir(exist_ok=True)
    (pathlib.Path("made") / str(os.getpid())).touch()
"""


def test_no_memory_of_a_run_stays_until_python_looks_for_garbage(monkeypatch):
    made = []

    def noted(*given, **options):
        simulation = simulation_of(*given, **options)
        made.extend(map(weakref.ref, (simulation.scene, simulation.loop, simulation.behaviours[0][0])))
        return simulation

    simulation_of = execute.simulation_of
    monkeypatch.setattr(execute, "simulation_of", noted)
    gc.disable()
    try:
        evac.repeat(evac.load("square_room", {"people.people.number": 3, "behaviours.walking": {}}), 2, workers=1)
        assert [one() for one in made] == 6 * [None]
    finally:
        gc.enable()


@pytest.fixture(scope="module")
def times():
    """Return the times of the study of the script, made in this process."""
    case = evac.load("square_room", {"people.people.number": 3, "contact.model": "dem"})
    return sorted(evac.repeat(case, 4, workers=1).times(0).tolist())


@pytest.mark.parametrize("how", [pytest.param("file", marks=pytest.mark.slow), "input"])
def test_a_script_without_a_guard_runs_once(tmp_path, times, how):
    (tmp_path / "here.py").write_text(TRACE)
    (tmp_path / "script.py").write_text(SCRIPT)
    done = subprocess.run(
        [sys.executable, "script.py" if how == "file" else "-"],
        cwd=tmp_path,
        input=SCRIPT if how == "input" else "",
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.splitlines() == ["began", "True", str(times)]
    assert not done.stderr


def test_a_class_without_a_file_stays_in_this_process(monkeypatch):
    monkeypatch.setattr("evac.study.execute.JOINING", 0.0)
    registry = evac.Registry()
    registry.add_class(type("Still", (evac.Behaviour,), {"name": "still", "act": lambda self, crowd, time: None}))
    case = evac.load("square_room", {"people.people.number": 3, "behaviours.still": {}}, registry=registry)
    with pytest.warns(ProcessWarning, match=r"Still.*plugin_files"):
        study = evac.repeat(case, 4, workers=2)
    assert study.done == 4
    with ThreadPoolExecutor(1) as executor, pytest.raises(PluginError, match=r"Still.*plugin_files"):
        evac.repeat(case, 4, executor=executor)


def test_plugin_files_of_a_registry_reach_other_processes(tmp_path, monkeypatch):
    monkeypatch.setattr("evac.study.execute.JOINING", 0.0)
    path = tmp_path / "halt.py"
    path.write_text(
        textwrap.dedent('''
        from evac import Behaviour, hookimpl
        evac_interface = 3

        class Halt(Behaviour):
            """Halts."""
            name = "halt"

            def act(self, crowd, time):
                pass

        @hookimpl
        def evac_behaviours():
            return [Halt]
        ''')
    )
    changes = {"people.people.number": 3, "behaviours.halt": {}}
    case = evac.load("square_room", changes, registry=evac.Registry([path]))
    assert evac.repeat(case, 3, workers=2).done == 3


def test_a_study_is_made_here_if_no_process_can_be_started(monkeypatch):
    def refuse(process):
        raise OSError("no more processes")

    monkeypatch.setattr("evac.study.execute.JOINING", 0.0)
    monkeypatch.setattr(multiprocessing.process.BaseProcess, "start", refuse)
    case = evac.load("square_room", {"people.people.number": 3})
    with pytest.warns(ProcessWarning, match="no other process"):
        study = evac.repeat(case, 4, workers=3)
    assert study.done == 4
