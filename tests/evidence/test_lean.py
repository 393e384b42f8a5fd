"""What leaving out saves."""

import numpy as np
import pytest

from evac.case.loading import load_case
from evac.evidence.lean import page as lean
from evac.evidence.lean.page import NAMED, Trial, parts_of, same_bits
from evac.simulation.simulation import Simulation


def state(value):
    return {name: np.array([value]) for name in lean.COMPARED}


def test_bits_are_compared_in_every_tick():
    one = Trial(0.0, 0.0, [state(1.0), state(np.nan)])
    assert same_bits(one, Trial(9.0, 9.0, [state(1.0), state(np.nan)]))
    assert not same_bits(one, Trial(0.0, 0.0, [state(np.nextafter(1.0, 2.0)), state(np.nan)]))
    assert not same_bits(one, Trial(0.0, 0.0, [state(1.0)]))
    assert not same_bits(Trial(0.0, 0.0, [state(0.0)]), Trial(0.0, 0.0, [state(-0.0)]))


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
