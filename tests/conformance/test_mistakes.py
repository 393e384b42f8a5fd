"""Typical mistakes in plugin files are told in one line with plugin, file, line and remedy; valid plugins run."""

import re

import pytest

from evac.base.errors import PluginError
from evac.case.loading import load_case
from evac.contract.registry import Registry
from evac.export.exporter import export
from evac.simulation.assembly import read_building
from evac.simulation.running import run
from evac.simulation.simulation import Simulation
from evac.trajectory.trajectory import read_trajectory
from tests.conformance.mistakes import FALSE_SOLVERS, MISTAKES, VALID
from tests.conformance.sound import SOLVER

#: Changes of the case that use the plugin, by the hook that returns it.
USES = {
    "evac_behavio": {"behaviours.tried": {}},
    "evac_force": {"forces.tried": {}},
    "evac_contact_model": {"contact.model": "tried", "simulation.step": 0.005},
    "evac_solver": {"contact.nsm2.solver": "tried"},
    "evac_recorder": {},
}


@pytest.fixture(scope="module")
def trajectory(tmp_path_factory):
    """The recorded motion of a short run."""
    folder = tmp_path_factory.mktemp("run") / "result"
    run(load_case("square_room", {"simulation.duration": 1.0, "output.animation": False}), folder)
    return read_trajectory(folder)


def use(path, trajectory, duration=0.5):
    """Use the plugin in a file as a case, a building or an export does; return the results of a run."""
    text = path.read_text()
    if "evac_importer" in text:
        plan = path.with_name("plan.zz")
        plan.write_text("a plan")
        read_building(plan, registry=Registry([path]))
    elif "evac_exporter" in text:
        export(trajectory, Registry([path]).get("exporter", "tried")(), path.with_name("out.npz"))
    else:
        changes = next(changes for hook, changes in USES.items() if hook in text)
        case = load_case("square_room", {"simulation.duration": duration, **changes}, [path])
        return Simulation(case, path.parent).run()
    return None


@pytest.mark.parametrize("name", MISTAKES)
def test_a_mistake_is_told_with_file_line_and_remedy(name, tmp_path, trajectory):
    mistake = MISTAKES[name]
    path = tmp_path / f"{name}.py"
    path.write_text(mistake.text)
    with pytest.raises(PluginError) as caught:
        use(path, trajectory)
    text = str(caught.value)
    before, place, after = text.partition(f" ({path}, line {mistake.line}); ")
    assert place, text
    assert "\n" not in text
    assert re.search(mistake.words, before), text
    remedy, _, hint = after.rpartition("; ")
    assert re.search(mistake.remedy, remedy), text
    assert hint.endswith(f"evac plugins --check {path}"), text
    assert "tried" in text or path.name in before or "kernel" in before, text


@pytest.mark.parametrize("name", VALID)
def test_a_valid_plugin_runs(name, tmp_path, trajectory):
    path = tmp_path / f"{name}.py"
    path.write_text(VALID[name])
    use(path, trajectory)


@pytest.mark.parametrize("name", FALSE_SOLVERS)
def test_a_solver_with_false_results_is_replaced_and_told_of(name, tmp_path, trajectory):
    path = tmp_path / f"{name}.py"
    path.write_text(FALSE_SOLVERS[name])
    results = use(path, trajectory, duration=2.5)
    assert results.report["failed_solves"] > 0
    assert results.report["retried_solves"] > 0
    assert results.report["unconverged_steps"] == 0
    (line,) = [line for line in results.quality_warnings if line.startswith("solver 'tried' failed")]
    assert f"failed {results.report['failed_solves']} time" in line
    assert f"({path}, line " in line
    assert line.endswith(f"evac plugins --check {path}")
    assert "\n" not in line


def test_a_sound_solver_of_a_plugin_has_no_failures(tmp_path, trajectory):
    path = tmp_path / "sound.py"
    path.write_text(SOLVER)
    results = use(path, trajectory, duration=2.5)
    assert results.report["solves"] > 0
    assert (results.report["failed_solves"], results.report["failed_solver"]) == (0, "")
    assert not [line for line in results.quality_warnings if "solver" in line]
