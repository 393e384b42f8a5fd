"""What leaving out saves."""

import numpy as np
import pytest

from evac.case.loading import load_case
from evac.evidence.lean import page as lean
from evac.evidence.lean.page import NAMED, Trial, same_bits
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
    assert next(row.state for row in lean_run.plan if row.part == label) == "out"
    assert len(full_run.forces) + len(full_run.behaviours) == 1 + len(lean_run.forces) + len(lean_run.behaviours)
