"""Escalators and moving walkways: the frame of the ground, the ways that lead over it, events, resumed runs."""

import math

import numpy as np
import pytest
from shapely import box

import evac
from evac.base.errors import BuildingError
from evac.simulation.shared import simulation_of
from tests.runs import run_ticks

RUBBING = """
from evac import hookimpl
from evac.jit import pair_friction
from evac.physics.contact.pair_contact import PairContact
from evac.base.parameters import Parameter

@pair_friction
def law(gap, closing_speed, sliding_speed, reduced_mass, elapsed, memory, parameters):
    return -parameters[0] * gap, -parameters[1] * sliding_speed

class Rubbing(PairContact):
    "A spring, and friction that grows with the speed."
    name = "rubbing"
    pair = law
    stiffness = Parameter(1e5, "k", unit="kg/s2")
    drag = Parameter(100.0, "c", unit="kg/s")

evac_interface = 3

@hookimpl
def evac_contact_models():
    return [Rubbing]
"""

ASIDE = """
from evac import hookimpl
from evac.people.behaviour import Behaviour

class Aside(Behaviour):
    "Everybody walks to the right, against the wall."
    name = "aside"
    writes = ("extra_direction",)

    def act(self, crowd, time):
        crowd.extra_direction[:] = 0.0, -1.0

evac_interface = 3

@hookimpl
def evac_behaviours():
    return [Aside]
"""


def walkway(speed=0.0, model="nsm2", plugin_files=(), **settings):
    """Return a case of one person on a flat walkway of 40 m between two halls, which moves at a speed or stands."""
    plan = evac.Plan()
    plan.storey("west", box(-5, 0, 0, 4))
    plan.storey("east", box(40, 0, 45, 4))
    plan.landing("walkway", box(0, 1, 40, 2.2), z=0.0)
    plan.exit("out", "east", [(45, 1), (45, 3)])
    moving = {"walkway": {"speed": speed, "towards": "east"}} if speed else {}
    person = {"name": "person", "positions": [[5.0, 1.6]], "level": "walkway landing z=0.00", "speed": 1.0}
    content = {
        "building": {"plan": plan, "moving": moving},
        "people": [{**person, "radius": 0.2, "mass": 70.0, "tau": 0.5}],
        "contact": {"model": model, **settings},
        "behaviours": {"aside": {}},
    }
    return evac.load(content, plugin_files=plugin_files)


def way_after(case, seconds, start):
    """Return the position and the velocity of the person after a time; it starts with a velocity along x."""
    simulation = simulation_of(case)
    crowd = simulation.population.crowd
    crowd.velocity[0, 0] = start
    while simulation.time < seconds:
        simulation.advance_tick()
    return crowd.position[0].copy(), crowd.velocity[0].copy()


@pytest.mark.parametrize(("model", "keys"), [("nsm2", {"tangential_dissipation": 200.0}), ("rubbing", {})])
def test_walls_beside_moving_ground_move_with_it(model, keys, tmp_path):
    """The motion is that on ground that stands, plus that of the ground."""
    for name, text in (("rubbing", RUBBING), ("aside", ASIDE)):
        (tmp_path / f"{name}.py").write_text(text)
    files = sorted(tmp_path.glob("*.py"))
    own = {model: keys} if keys else {}
    still, velocity = way_after(walkway(0.0, model, files, **own), 6.0, 0.0)
    moved, faster = way_after(walkway(0.5, model, files, **own), 6.0, 0.5)
    assert still[1] == pytest.approx(1.2, abs=0.01)  # at the wall
    assert velocity[0] < 0.69  # friction brakes
    assert moved - still == pytest.approx([3.0, 0.0], abs=1e-9)
    assert faster - velocity == pytest.approx([0.5, 0.0], abs=1e-9)


def escalators(events=(), people=(), **moving):
    """Return a case with two flights of 10 m at 30 degrees beside each other, and exits on both storeys."""
    run, rise = 10.0 * math.cos(math.radians(30.0)), 5.0
    plan = evac.Plan()
    plan.storey("low", box(-6, 0, 0, 4))
    plan.storey("high", box(run, 0, run + 6, 4), z=rise)
    for name, y in (("one", 0.5), ("two", 2.5)):
        plan.stair(name, "low", [(0, y), (0, y + 1)], "high", [(run, y), (run, y + 1)])
    plan.exit("bottom", "low", [(-6, 1), (-6, 3)])
    plan.exit("top", "high", [(run + 6, 1), (run + 6, 3)])
    content = {
        "building": {"plan": plan, "moving": moving},
        "people": list(people),
        "contact": {"model": "nsm2"},
        "behaviours": {"walking": {}, "riding": {}},
        "directions": {"spacing": 0.2},
        "event": list(events),
        "simulation": {"duration": 120.0},
    }
    return evac.load(content)


UP = {"name": "up", "level": "low", "number": 12, "exits": ["top"], "speed_up": 0.6}


def stairs_taken(simulation):
    """Return the names of the stairs on which people have been."""
    taken, building = set(), simulation.scene.building
    while not simulation.ended:
        simulation.advance_tick()
        taken |= {building.levels[level].stair for level in simulation.population.crowd.level if level >= 0}
    return taken - {None}


def test_ways_lead_over_what_moves_their_way():
    up, down = {"speed": 0.5}, {"speed": 0.5, "towards": "down"}
    assert stairs_taken(simulation_of(escalators(people=[UP], one=up, two=down))) == {"one"}
    assert stairs_taken(simulation_of(escalators(people=[UP], one=down, two={"speed": 0.5, "towards": "high"}))) == {
        "two"
    }


def test_an_event_stops_and_turns_an_escalator():
    down = {"speed": 0.5, "towards": "down"}
    events = [
        {"time": 5.0, "kind": "move", "target": "one", "value": False},
        {"time": 60.0, "kind": "move", "target": "two", "value": {"speed": 0.4}},
    ]
    simulation = simulation_of(escalators(events, [UP], one=down, two=down))
    assert not simulation.scene.building.leads_from(simulation.scene.building.portals[0], 0)
    assert stairs_taken(simulation) == {"one"}
    assert str(simulation.ended) == "everybody out"
    stopped = simulation.scene.changes[0]
    assert (stopped.kind, stopped.what, stopped.values["value"]) == ("move", "one", False)


def test_who_was_turned_back_on_the_line_of_an_escalator_follows_its_other_direction():
    simulation = simulation_of(escalators(people=[UP | {"number": 1}], two={"speed": 0.5, "towards": "down"}))
    crowd, building = simulation.population.crowd, simulation.scene.building
    top = next(way for way in building.portals if "one" in way.name and "high" in way.name)
    flight = next(level.index for level in building.levels if level.stair == "one")
    while crowd.level[0] != flight or crowd.position[0, 0] < top.segments[0, 0] - 0.15:
        simulation.advance_tick()
    for wait, towards in ((0.1, "down"), (0.2, "up")):
        value = {"speed": 0.75, "towards": towards}
        simulation.scene.apply(evac.Change(simulation.time + wait, "move", "one", {"value": value}))
    run_ticks(simulation, 2)
    assert crowd.ahead[0, 0] < 0.0
    run_ticks(simulation, 100)
    assert simulation.ended == "everybody out"


def test_the_trajectory_has_what_moves(tmp_path):
    results = evac.run(escalators(people=[UP], one={"speed": 0.5}).change({"simulation.duration": 2.0}), tmp_path / "r")
    read = evac.read_trajectory(tmp_path / "r").building
    assert read.moving == results.building.moving
    assert np.hypot(*read.ground_velocity.T).max() == pytest.approx(0.5 * math.cos(math.radians(30.0)))


@pytest.mark.parametrize(
    ("name", "moving"), [("three", {"speed": 0.5}), ("one", {"speed": 0.5, "towards": "elsewhere"})]
)
def test_what_cannot_move_is_refused_by_name(name, moving):
    with pytest.raises(BuildingError, match=name):
        simulation_of(escalators(people=[UP], **{name: moving}))
