"""Families and classes: how far apart they are, that they gather and are counted first, and resumed runs."""

import numpy as np
import pytest
from shapely import box

import evac
from evac.simulation.simulation import Simulation
from tests.runs import assert_same_bits, run_ticks

#: Speeds of the four people of each family [m/s].
SPEEDS = [0.6, 1.0, 1.4, 1.6]


def corridor(*groups, **parameters):
    """Return the simulation of groups (name, number, settings, speeds) in a corridor, who pass a hall at 20 to 24 m."""
    plan = evac.Plan()
    plan.storey("floor", box(0, 0, 60, 4))
    plan.exit("out", "floor", [(60, 0), (60, 4)])
    plan.area("home", "floor", box(0.5, 0.5, 8, 3.5))
    plan.area("hall", "floor", box(20, 0.5, 24, 3.5))
    people = [
        {
            "name": name,
            "number": number,
            "area": "home",
            "speed": {"list": speeds},
            "behaviours": {"together": settings},
        }
        for name, number, settings, speeds in groups
    ]
    content = {"building": plan, "people": people, "behaviours": {"walking": {}, "together": parameters}}
    return Simulation(evac.load(content | {"contact": {"model": "nsm2"}}))


def families(settings, **parameters):
    return corridor(("families", 12, settings, SPEEDS * 3), **parameters)


def test_families_wait_for_their_slowest_and_not_for_others():
    """Alone, the fastest of a family are 25.8 m ahead of the slowest in the middle of the run, and out 55 s before."""
    simulation = families({"size": 4})
    crowd, spreads = simulation.population.crowd, []
    while not simulation.ended:
        simulation.advance_tick()
        if simulation.time > 15.0 and (crowd.level >= 0).all():
            spreads += list(np.ptp(crowd.position[:, 0].reshape(3, 4), axis=1))
    assert simulation.ended == "everybody out"
    assert max(spreads) < 4.0
    out = crowd.exit_time.reshape(3, 4)
    assert np.ptp(out, axis=1).max() < 8.0


def test_a_unit_gathers_and_is_counted_before_it_leaves():
    """A class and its teacher are one unit of two groups."""
    teacher = ("teacher", 1, {"unit": "class", "gather": "hall"}, [0.8])
    pupils = ("pupils", 8, {"unit": "class", "gather": "hall"}, [0.6, 1.0, 1.2, 1.4] * 2)
    simulation = corridor(teacher, pupils, places=["hall"], count=7.0)
    crowd = simulation.population.crowd
    arrived = left = None
    while not simulation.ended:
        simulation.advance_tick()
        x, is_still = crowd.position[:, 0], np.hypot(*simulation.displacement_velocity.T) < 0.1
        if arrived is None and ((x > 20) & (x < 24) & is_still).all():
            arrived = simulation.time
        if left is None and (x > 24.0).any():
            left = simulation.time
    assert simulation.ended == "everybody out"
    assert arrived is not None
    assert left - arrived > 7.0
    assert np.ptp(crowd.exit_time) < 8.0


def test_a_unit_leaves_without_those_who_do_not_come():
    simulation = corridor(("family", 2, {"gather": "hall"}, [1.2, 0.0]), places=["hall"], patience=20.0, count=0.0)
    crowd = simulation.population.crowd
    run_ticks(simulation, 900)
    assert np.isfinite(crowd.exit_time).tolist() == [True, False]


def test_without_the_keys_nobody_takes_part():
    simulation = corridor(("people", 4, {}, SPEEDS))
    assert "together" not in {behaviour.name for behaviour, _ in simulation.behaviours}


def test_a_unit_of_which_nobody_comes_is_left_out():
    case = corridor(("here", 2, {"gather": "hall"}, [1.2, 1.0]), places=["hall"], count=0.0).case.to_dict()
    rare = {"arrive": {"rate": 1e-6, "from": 0.0, "to": 1.0}, "behaviours": {"together": {"size": 2}}}
    case["people"].append({"name": "rare", "area": "home"} | rare)
    assert Simulation(evac.load(case)).run().ended == "everybody out"


def test_a_run_goes_on_to_the_same_bits():
    def one_more():
        return families({"size": 4, "gather": "hall"}, places=["hall"], count=3.0)

    one, other = one_more(), one_more()
    for ticks in (150, 300):
        run_ticks(one, ticks)
        other.restore(one.state())
        run_ticks(one, 60)
        run_ticks(other, 60)
        assert_same_bits(one, other)
        one, other = one_more(), one_more()


@pytest.mark.parametrize(
    ("settings", "places", "line"),
    [
        ({"gather": "hall"}, [], r"people\.families\.behaviours\.together\.gather: 'hall' is not in behaviours"),
        ({"gather": "hal"}, ["hall"], r"'hal' is not in behaviours\.together\.places; .*'hall'"),
        ({"size": -1}, [], r"together\.size: .*0"),
        ({"gather": "hal"}, ["hal"], r"behaviours\.together\.places: no area is named 'hal'; .*'hall'"),
        ({"gather": "hall"}, "hall", r"together\.places: must be a list of strings, not 'hall'"),
        ({"size": 4}, [["hall"]], r"together\.places: must be a list of strings"),
    ],
)
def test_mistakes_are_named(settings, places, line):
    with pytest.raises(evac.EvacError, match=line):
        families(settings, places=places)
