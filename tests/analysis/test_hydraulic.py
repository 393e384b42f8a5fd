"""The hydraulic calculation, with numbers worked by hand from the handbook's formulas."""

import math
from dataclasses import replace

import numpy as np
import pytest

from evac.analysis.hydraulic import STAIR_K, design_flows, hydraulic_time, stair_k
from evac.analysis.lines import LineFlow


def passages(kind, name, levels, width, time):
    time = np.asarray(time, float)
    person = np.arange(len(time), dtype=np.int32)
    lines = np.zeros((1, 4)), width, ("forward", "back")
    return LineFlow(kind, name, levels, *lines, person, time, np.ones(len(time), bool))


def test_the_specific_flows_are_those_of_the_handbook():
    # Table 59.5: 1.32 for doors; 1.16, 1.09, 1.01 and 0.94 persons/s/m for four stairs.
    flows = [round(stair_k(slope) / (4 * 0.266), 2) for slope in (0.05, 6.5 / 13, 6.5 / 12, 7 / 11, 7.5 / 10)]
    assert flows == [1.32, 1.16, 1.09, 1.02, 0.94]


def test_a_door_and_a_stair_have_their_flow_their_people_and_their_time(building):
    time = 10.0 + 0.5 * np.arange(40)
    lines = [
        passages("exit", "door", (0,), 1.0, time + 5.0),
        passages("portal", "portal 0", (0, 1), 2.0, time),
        passages("portal", "portal 1", (1, 2), 2.0, time[:30]),
        passages("line", "own", (0,), 2.0, time),
    ]
    found = {one.name: one for one in design_flows(building, lines, time + 5.0)}
    assert set(found) == {"door", "lower"}
    door, stair = found["door"], found["lower"]
    assert (door.people, stair.people, stair.kind) == (40, 40, "stair")
    assert door.hydraulic_flow == pytest.approx(1.3158 * 0.7, rel=1e-4)
    assert door.flow == pytest.approx(2.0)
    assert (door.laboratory_flow, stair.laboratory_flow) == (2.8, None)
    assert (door.capacity, stair.capacity) == (200, 263)
    # The flight rises 3 m over 4 m: k = 1.00, 0.9398 persons/s/m of 1.7 m.
    assert stair.hydraulic_flow == pytest.approx(0.9398 * 1.7, rel=1e-4)
    assert stair.hydraulic_time == pytest.approx(10.0 + 40 / (0.9398 * 1.7) + 5.0, rel=1e-4)
    assert door.hydraulic_time == pytest.approx(15.0 + 40 / (1.3158 * 0.7), rel=1e-4)
    assert hydraulic_time(found.values()).name == "door"


def test_who_passes_again_is_counted_once_and_portals_within_a_stair_are_none(building):
    again = passages("exit", "door", (0,), 1.0, 10.0 + 0.5 * np.arange(60))
    again = replace(again, person=again.person % 40)
    (door,) = design_flows(building, [again], np.full(40, 50.0))
    assert (door.people, door.hydraulic_time) == (40, pytest.approx(10.0 + 40 / (1.3158 * 0.7) + 20.5, rel=1e-4))
    back = replace(again, forward=np.arange(60) < 40)  # 20 people come back
    (door,) = design_flows(building, [back], np.full(40, 50.0))
    assert door.people == 20
    both = replace(again, person=np.arange(60, dtype=np.int32) % 30, forward=np.arange(60) < 30)  # all do
    assert design_flows(building, [both], np.full(40, 50.0)) == []
    inner = replace(building, levels=tuple(replace(level, stair="one") for level in building.levels))
    assert design_flows(inner, [passages("portal", "portal 0", (0, 1), 2.0, [1.0])], np.array([2.0])) == []


def test_nothing_passes_what_is_as_narrow_as_its_boundary_layers(building):
    (door,) = design_flows(building, [passages("exit", "door", (0,), 0.3, [1.0])], np.array([1.0]))
    assert (door.hydraulic_flow, door.hydraulic_time) == (0.0, np.inf)
    assert hydraulic_time([door]) is None


def test_k_of_stairs_follows_the_root_of_tread_over_riser():
    for slope, k in STAIR_K:
        assert k == pytest.approx(0.863 / math.sqrt(slope), rel=0.012)
