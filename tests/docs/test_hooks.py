"""Each hook is documented with its signature and does what it says."""

import inspect
import re
import textwrap
from dataclasses import replace

import pytest

import evac
from evac.contract import hooks
from evac.contract.registry import Registry
from evac.export.exporter import export
from tests.docs.conftest import table

HOOKS = [name for name, item in vars(hooks).items() if name.startswith("evac_") and inspect.isfunction(item)]


@pytest.fixture
def plugin(tmp_path):
    """Write a plugin file and return its path."""

    def write(text):
        path = tmp_path / "plugin.py"
        path.write_text("from evac import hookimpl\nevac_interface = 3\n" + textwrap.dedent(text), encoding="utf-8")
        return path

    return write


@pytest.mark.parametrize("hook", HOOKS)
def test_every_hook_is_documented_with_its_signature_and_has_a_test(hook):
    signature = re.sub(r"'|collections\.abc\.|pathlib\.|typing\.", "", str(inspect.signature(getattr(hooks, hook))))
    assert f"- `{hook}{signature}`: {inspect.getdoc(getattr(hooks, hook))}" in table("hooks")
    assert hook in KINDS or callable(globals()[f"test_{hook}"])


CLASS = """
    from evac import {base}, Parameter

    class Mine({base}):
        '''Mine.'''
        name = "mine"
        pair = None
        def cutoff(self):
            return 0.0
        def record(self, simulation):
            pass
        def prepare(self, scene):
            pass

    @hookimpl
    def {hook}():
        return [Mine]
"""


#: Hooks that register classes: their kind, their base class, and its method that stands for `cutoff`.
KINDS = {
    "evac_contact_models": ("contact_model", "ContactModel", ""),
    "evac_solvers": ("solver", "Solver", ""),
    "evac_forces": ("force", "Force", ""),
    "evac_behaviours": ("behaviour", "Behaviour", ""),
    "evac_condition_sources": (
        "condition_source",
        "ConditionSource",
        "def open(self, scene): ...\n        def at(self, quantities, time, level, position, height)",
    ),
    "evac_smoke_laws": ("smoke_law", "SmokeLaw", "def speed(self, desired, extinction)"),
    "evac_recorders": ("recorder", "Recorder", ""),
    "evac_dispatchers": ("dispatcher", "Dispatcher", "def next_stop(self, car, calls, time)"),
}


@pytest.mark.parametrize("hook", KINDS)
def test_classes_are_registered(hook, plugin):
    kind, base, method = KINDS[hook]
    text = CLASS.replace("def cutoff(self)", method) if method else CLASS
    registry = Registry([plugin(text.format(base=base, hook=hook))])
    assert issubclass(registry.get(kind, "mine"), getattr(evac, base))


def test_evac_exporters(plugin, tmp_path):
    """Runs are written in a format of one's own; a suffix that is none is refused."""
    text = """
        from evac import Exporter

        class Mine(Exporter):
            '''The number of frames.'''
            name = "mine"
            suffix = ".mine"

            def write(self, trajectory, path):
                path.write_text(str(len(trajectory)))
                return [path]

        @hookimpl
        def evac_exporters():
            return [Mine]
        """
    registry = Registry([plugin(text)])
    evac.run(evac.load("square_room", {"simulation.duration": 1.0}), tmp_path / "result")
    written = export(evac.read_trajectory(tmp_path / "result"), registry.get("exporter", "mine")())
    assert [path.read_text() for path in written] == ["3"]
    with pytest.raises(evac.PluginError, match=r"Mine\.suffix"):
        Registry([plugin(text.replace('".mine"', '"MINE"'))])


def test_evac_building_cases(plugin, tmp_path, root):
    folder = tmp_path / "my_room"
    folder.mkdir()
    for name in ("case.toml", "square_room.msh"):
        (folder / name).write_bytes((root / "buildings/square_room" / name).read_bytes())
    path = plugin(
        """
        from pathlib import Path

        @hookimpl
        def evac_building_cases():
            return [Path(__file__).parent / "my_room"]
        """
    )
    assert evac.load("my_room", plugin_files=[path]).source == folder / "case.toml"


def test_evac_importers(plugin, tmp_path):
    """A file of a format of one's own is read, with the parameters that the case gives."""
    path = plugin(
        """
        from evac import Importer, Parameter, SurfaceMesh

        class Mine(Importer):
            '''Rectangles: a line of two numbers for each.'''
            name = "mine"
            suffixes = (".mine",)
            door = Parameter(1.0, "width of the door", unit="m", above=0)

            def read(self, path):
                x, y = map(float, path.read_text().split())
                points = [[0, 0, 0], [x, 0, 0], [x, y, 0], [0, y, 0], [0, self.door, 0]]
                return SurfaceMesh(points, [[0, 1, 2, 3]], {"floor:room": [True]}, {"exit:door": [[0, 4]]})

        @hookimpl
        def evac_importers():
            return [Mine]
        """
    )
    (tmp_path / "room.mine").write_text("5 5")
    case = evac.load("square_room", {"building.mesh": str(tmp_path / "room.mine")}, plugin_files=[path])
    assert [way.width for way in evac.Simulation(case).building.exits] == [1.0]
    simulation = evac.Simulation(case.change({"importers.mine.door": 1.2}))
    assert [way.width for way in simulation.building.exits] == [1.2]
    assert any(plugin.startswith(str(path)) for plugin in simulation.results().plugins)
    (tmp_path / "room.mine").write_text("5 x")
    with pytest.raises(evac.BuildingError, match=r"room\.mine: "):
        evac.Simulation(case)
    with pytest.raises(evac.BuildingError, match=r"'\.mine'"):
        evac.Simulation(case.change({"importers.mine": False}))


def test_evac_configure(plugin):
    path = plugin(
        """
        from evac import ScenarioError

        @hookimpl
        def evac_configure(case, registry):
            if case.contact.model in registry.contact_models:
                raise ScenarioError(f"not with {case.contact.model}")
        """
    )
    with pytest.raises(evac.ScenarioError, match="nsm2"):
        evac.Simulation(evac.load("square_room", plugin_files=[path]))


def test_evac_prepare(plugin):
    path = plugin(
        """
        @hookimpl
        def evac_prepare(simulation):
            simulation.population.crowd.start_time[:] = 1.0
        """
    )
    simulation = evac.Simulation(evac.load("square_room", plugin_files=[path]))
    for _ in range(10):
        simulation.advance_tick()
    assert (simulation.population.crowd.distance == 0.0).all()


def test_evac_finish(plugin):
    path = plugin(
        """
        seen = []

        @hookimpl
        def evac_finish(simulation, results, error):
            simulation.case.registry.seen = (simulation.time, results, error)
        """
    )
    case = evac.load("square_room", {"simulation.duration": 0.5}, plugin_files=[path])
    results = evac.run(case)
    time, finished, error = case.registry.seen
    assert (time, error) == (0.5, None)
    assert replace(finished, phases=results.phases) == results  # writing takes time, too

    def stop(progress):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        evac.run(case, progress=stop)
    time, results, error = case.registry.seen
    assert (time, results) == (0.1, None)
    assert isinstance(error, KeyboardInterrupt)


def test_evac_metrics(plugin):
    path = plugin(
        """
        @hookimpl
        def evac_metrics(results):
            return {"people": results.number_of_people}
        """
    )
    case = evac.load("square_room", {"simulation.duration": 0.5}, plugin_files=[path])
    assert evac.run(case).metrics == {str(path): {"people": 20}}
