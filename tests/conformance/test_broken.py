"""Each check finds the promise it is there for, broken, and says so in a message of one form."""

import re
import sys

import pytest

from evac.base.errors import PluginError
from evac.case.loading import load_case
from evac.conformance import check_plugin
from evac.contract.registry import Registry
from tests.conformance import (
    broken_behaviours,
    broken_cases,
    broken_classes,
    broken_contact_models,
    broken_dispatchers,
    broken_forces,
    broken_solvers,
)
from tests.conformance.broken_behaviours import Seeks, Slower
from tests.conformance.broken_cases import Counting
from tests.conformance.broken_contact_models import Linear, Tunes
from tests.conformance.broken_solvers import solver, sound

#: Plugin, check, what was examined, what is wrong, and the remedy, without file and line.
FORM = re.compile(r"(.+?): (check_\w+), (scene '.+?'|the [^:]+|its [^:]+): (.+); (.+)")

#: File and line of a mistake.
PLACE = re.compile(r" \(/.+?\.py, line \d+\)")

BROKEN = [
    pytest.param(broken, id=f"{module.__name__.rpartition('.')[2]}-{k}")
    for module in (
        broken_classes,
        broken_contact_models,
        broken_solvers,
        broken_forces,
        broken_behaviours,
        broken_cases,
        broken_dispatchers,
    )
    for k, broken in enumerate(module.BROKEN)
]


@pytest.mark.parametrize("broken", BROKEN)
def test_a_failure_names_plugin_check_scene_and_remedy(broken):
    with pytest.raises(PluginError) as failure:
        check_plugin(broken.cls, **broken.values)
    text = str(failure.value)
    assert PLACE.search(text) or "module_of" in broken.cls.__module__, text  # which has no file
    found = FORM.fullmatch(PLACE.sub("", text))
    assert found, text
    plugin, check, examined, wrong, remedy = found.groups()
    assert plugin in (broken.cls.name, getattr(broken.cls, "__name__", "")), text
    assert re.fullmatch(broken.check, check), text
    assert re.match(broken.examined, examined), text
    assert re.search(broken.words, f"{wrong}; {remedy}"), text
    if broken.raises:
        assert isinstance(failure.value.__cause__, broken.raises)


def test_every_check_is_failed_by_a_broken_plugin():
    modules = [vars(module) for name, module in sys.modules.items() if name.startswith("evac.conformance")]
    checks = {name for module in modules for name, found in module.items() if name.startswith("check_")}
    imported = {"check_plugin", "check_class", "check_interface", "check_surface", "check_written", "check_solve"}
    assert checks - imported == {broken.values[0].check for broken in BROKEN}


def test_a_good_law_conforms():
    check_plugin(Linear)


def test_a_model_may_scale_with_mass():
    check_plugin(Tunes, frequency=30.0)


def test_a_sound_solver_passes():
    check_plugin(solver(sound))


def test_a_good_behaviour_passes():
    check_plugin(Slower)


def test_a_behaviour_that_needs_its_own_area_is_told_to_be_checked_in_its_own_case():
    with pytest.raises(PluginError, match=r"'cloakroom' .*; .*--case CASE"):
        check_plugin(Seeks)
    with pytest.raises(PluginError) as failure:
        check_plugin(Seeks, load_case("square_room"))
    assert "--case" not in str(failure.value)


def test_a_behaviour_is_checked_in_a_case_that_uses_it():
    with pytest.raises(PluginError, match=r"check_declared_arrays, scene .* behaviour 'slower' .*; give a case"):
        check_plugin(Slower, load_case("square_room"))


def test_an_importer_that_reads_another_surface_each_time_is_found(tmp_path):
    registry = Registry()
    registry.add_class(Counting)
    (tmp_path / "room.plan").write_text("square")
    changes = {"building.mesh": str(tmp_path / "room.plan"), "building.areas": []}
    case = load_case("square_room", changes, registry=registry)
    with pytest.raises(PluginError, match=r"check_surface, scene '.*room\.plan': .* points .*state"):
        check_plugin(Counting, case)
    with pytest.raises(PluginError, match=r"'meshio' .*'counting'"):
        check_plugin(Counting, load_case("square_room", registry=registry))
