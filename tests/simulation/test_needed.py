"""The plan: which parts a scene needs, and why."""

import numpy as np
import pytest

from evac.case.loading import load_case
from evac.directions.march.waves import march_waves
from evac.directions.routes import STRATEGIES, Route
from evac.simulation.checkpoints import kernels_of
from evac.simulation.needed import needed_routes, run_kernels
from evac.simulation.simulation import Simulation


def plan_of(case, changes=(), full=False):
    simulation = Simulation(load_case(case, dict(changes)), full=full)
    return {row.part: (row.state == "in", row.why) for row in simulation.plan}, simulation


def test_square_room_needs_next_to_nothing():
    plan, simulation = plan_of("square_room")
    needed = {name for name, (is_in, _) in plan.items() if is_in}
    outputs = {"tables", "picture", "replay", "trajectory", "animation"}
    assert needed == {"fields: fastest", "contact solves", "solver accelerated_sweeps", *outputs}
    assert plan["portals"][1] == "0 portals, 1 level"
    assert simulation.fields.routes == (Route(),)
    assert simulation.forces == []
    assert simulation.behaviours == []


def test_the_school_needs_its_stairs_its_force_and_its_behaviours():
    plan, simulation = plan_of("primary_school")
    for name in (
        "portals",
        "stair speeds",
        "force: social",
        "behaviour: response_time",
        "behaviour: teacher_following",
    ):
        assert plan[name][0], name
    assert plan["behaviour: response_time"][1] == "once, before the first step"
    assert plan["behaviour: teacher_following"][1] == "at every tick"
    assert plan["force: social"][1].endswith(f"{0.08 * np.log(2000.0):.2f} m")
    assert [behaviour.name for behaviour, _ in simulation.behaviours] == ["response_time", "teacher_following"]


@pytest.mark.parametrize(
    ("changes", "part", "why"),
    [
        ({"forces.social.strength": 0.0}, "force: social", "it is zero everywhere"),
        ({"behaviours.response_time.time": {"constant": 0}}, "behaviour: response_time", "it affects nobody"),
        ({"behaviours.teacher_following.lag": 5.0}, "behaviour: teacher_following", "it affects nobody"),
        ({"contact.nsm2.tangential_dissipation": 0.0}, "tangential contact", "K_T = 0 kg"),
        ({"output.picture": False}, "picture", "output.picture = false"),
    ],
)
def test_what_would_change_nothing_is_out(changes, part, why):
    plan, simulation = plan_of("square_room", changes)
    assert plan[part] == (False, why)
    assert simulation.forces == []
    assert simulation.behaviours == []


def test_full_puts_everything_in():
    changes = {"forces.social.strength": 0.0, "behaviours.response_time.time": {"constant": 0}}
    _, simulation = plan_of("square_room", changes, full=True)
    assert [force.name for force in simulation.forces] == ["social"]
    assert [behaviour.name for behaviour, _ in simulation.behaviours] == ["response_time"]
    assert {route.strategy for route in simulation.fields.routes} == set(STRATEGIES)
    assert simulation.engine.full


def test_a_route_is_needed_where_somebody_takes_it():
    case = load_case("square_room", {"people.people.strategy": "shortest"})
    assert needed_routes(case, [], False) == (Route((), "shortest"),)
    assert needed_routes(case, [], True)[0] == Route((), "shortest")
    assert {route.strategy for route in needed_routes(case, [], True)} == set(STRATEGIES)


def test_full_is_told_as_it_was_done():
    changes = {"forces.social.strength": 0.0, "behaviours.response_time.time": {"constant": 0}}
    plan, _ = plan_of("square_room", changes, full=True)
    assert plan["force: social"][0]
    assert "0.00 m" in plan["force: social"][1]
    assert plan["behaviour: response_time"][0]


def test_kernels_of_behaviours_are_loaded_at_the_start_and_named_by_checkpoints():
    _, simulation = plan_of("square_room", {"behaviours.headway": {}})
    assert any(label.startswith("evac_plugins.behaviour_headway.") for label in kernels_of(simulation))


@pytest.mark.parametrize(
    ("changes", "is_loaded"),
    [({}, False), ({"people.people.strategy": "quickest"}, True), ({"behaviours.walking": {}}, True)],
)
def test_the_march_of_ways_that_follow_the_crowd_is_loaded_where_there_are_such_ways(changes, is_loaded):
    _, simulation = plan_of("square_room", changes)
    behaviours = [behaviour for behaviour, _ in simulation.behaviours]
    parts = type(simulation.engine), simulation.building, simulation.contact, simulation.forces, behaviours
    assert (march_waves in run_kernels(simulation.case, *parts, full=False)) == is_loaded
