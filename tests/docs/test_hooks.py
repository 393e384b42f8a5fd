"""Each hook is documented with its signature and does what it says."""

import inspect
import re
import textwrap
from dataclasses import replace

import pytest

import evac
from evac.contract import hooks
from evac.contract.registry import Registry
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
    "evac_importers": ("importer", "Importer", "suffixes = ('.mine',)\n        def read(self, path)"),
    "evac_exporters": ("exporter", "Exporter", "suffix = '.mine'\n        def write(self, trajectory, path)"),
}


@pytest.mark.parametrize("hook", KINDS)
def test_classes_are_registered(hook, plugin):
    kind, base, method = KINDS[hook]
    text = CLASS.replace("def cutoff(self)", method) if method else CLASS
    registry = Registry([plugin(text.format(base=base, hook=hook))])
    assert issubclass(registry.get(kind, "mine"), getattr(evac, base))


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
