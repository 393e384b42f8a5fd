"""What leaving out saves."""

import numpy as np
import pytest

from evac.case.loading import load_case
from evac.evidence.evidence import in_fresh_process
from evac.evidence.lean import kernels
from evac.evidence.lean import page as lean
from evac.evidence.lean.page import LEAN, NAMED, Part, Trial, parts_of, same_bits, trial
from evac.simulation.simulation import Simulation


def state(value):
    return {name: np.array([value]) for name in lean.COMPARED}


def test_bits_are_compared_in_every_tick():
    one = Trial(0.0, 0.0, [state(1.0), state(np.nan)])
    assert same_bits(one, Trial(9.0, 9.0, [state(1.0), state(np.nan)]))
    assert not same_bits(one, Trial(0.0, 0.0, [state(np.nextafter(1.0, 2.0)), state(np.nan)]))
    assert not same_bits(one, Trial(0.0, 0.0, [state(1.0)]))
    assert not same_bits(Trial(0.0, 0.0, [state(0.0)]), Trial(0.0, 0.0, [state(-0.0)]))


def test_another_seed_is_not_the_same():
    case = load_case("square_room", {"simulation.duration": 0.5})
    assert same_bits(trial(case, LEAN), trial(case, Part("all", full=True, loop=("tests", *lean.LOOP))))
    assert not same_bits(trial(case, LEAN), trial(case.change({"simulation.seed": 2}), LEAN))


@pytest.mark.parametrize("part", NAMED, ids=lambda part: part.name)
def test_each_part_is_out_until_it_is_forced_in(part):
    case = load_case("square_room", dict(part.overrides))
    label = part.name.partition(",")[0]
    lean_run, full_run = Simulation(case), Simulation(case, full=True)
    assert next(entry.is_in for entry in lean_run.plan if entry.name == label) is False
    assert len(full_run.forces) + len(full_run.behaviours) == 1 + len(lean_run.forces) + len(lean_run.behaviours)


@pytest.mark.parametrize("model", lean.MODELS)
def test_every_part_that_explain_lists_as_out_has_a_row_or_cannot_be_forced_in(model):
    case = load_case("square_room", lean.model_overrides(model))
    out = {part.name for part in Simulation(case).plan if not part.is_in}
    told = {"portals: tests for walls, portals and exits": "portals"}
    have = {told.get(part.name, part.name) for part in parts_of("square_room", model, ())}
    have |= {name.partition(",")[0] for name in have if name.startswith("tangential contact")}
    # What explain says of forces and behaviours when none is named stands for those of NAMED.
    assert out - have == {
        "stair speeds",
        "forces at a distance",
        "behaviours",
        "people outside",
        "ways round the crowd",
    } | ({"position correction"} if model == "NSM2" else set())


@pytest.mark.slow
def test_what_a_case_loads_is_what_its_step_loop_needs():
    simulation = Simulation(load_case("square_room", lean.model_overrides("DEM")))
    needed = {entry.label for entry in simulation.engine.entries(simulation.contact)}
    found = in_fresh_process(
        kernels.loaded, "square_room", lean.model_overrides("DEM"), False, ["evac_plugins.contact_dem.spring"]
    )
    assert needed <= set(found["kernels"])
    assert next(iter(found["kernels"])) == "evac_plugins.contact_dem.spring"
    assert found["functions"] > len(found["kernels"])
    assert all(span > 0.0 and size > 0 for span, size in found["kernels"].values())
    assert not any("seams" in label or "solver" in label for label in found["kernels"])
