"""Helpers: who fetches whom, how fast they go together, where they go, and resumed runs."""

import math

import numpy as np
import pytest
from shapely import box

import evac
from evac.building.model.building import FLAT
from evac.simulation.shared import simulation_of
from tests.people.test_mobility import two_ways

HALL = {"name": "hall", "kind": "assembly", "area": "hall"}


def ward(*places, patients=None, staff=None, device="evacuation_chair", **parameters):
    """Return a case of patients upstairs, and staff downstairs who fetch them over a stair of 5 m in plan, 3 m high."""
    plan = evac.Plan()
    plan.storey("low", box(0, 0, 14, 10))
    plan.storey("high", box(19, 0, 33, 10), z=3.0)
    plan.flight("stairs", [(14, 4), (14, 6)], 0.0, [(19, 4), (19, 6)], 3.0)
    plan.exit("out", "low", [(0, 4), (0, 6)])
    plan.area("ward", "high", box(25, 1, 32, 9))
    plan.area("office", "low", box(5, 1, 9, 9))
    plan.area("hall", "low", box(1, 7, 4, 9.8))
    plan.area("lobby", "high", box(20, 7, 23, 9.8))
    own, fetch = {"helpers": {"device": device}}, {"helpers": {"fetches": "patients"}}
    people = [
        {"name": "patients", "area": "ward", "number": 1, "behaviours": own} | (patients or {}),
        {"name": "staff", "area": "office", "number": 2, "behaviours": fetch} | (staff or {}),
    ]
    content = {"building": plan, "people": people, "place": list(places), "contact": {"model": "nsm2"}}
    behaviours = {"walking": {}, "helpers": {"areas": ["ward"], "preparation": 10.0} | parameters}
    coarse = {"directions": {"spacing": 0.2}, "output": {"trajectory": False}}
    return evac.load(content | coarse | {"behaviours": behaviours})


def run(case):
    """Return the simulation of a case at its end, and who was where at each tick: position, level (ticks, people)."""
    simulation, position, level = simulation_of(case), [], []
    while not simulation.ended:
        simulation.advance_tick()
        position.append(simulation.population.crowd.position.copy())
        level.append(simulation.population.crowd.level.copy())
    return simulation, np.array(position), np.array(level)


def test_helpers_fetch_people_and_bring_them_out_at_the_speed_of_the_device():
    simulation, position, level = run(ward(patients={"number": 2}))
    assert simulation.ended == "everybody out"
    speed = np.hypot(*np.moveaxis(np.diff(position, axis=0), 2, 0)) / 0.1
    stair = simulation.building.stairs["stairs"]
    on_stair = np.isin(level[:-1], stair) & np.isin(level[1:], stair)
    slope = 5.0 / math.hypot(5.0, 3.0)
    patients, staff = np.array([0, 1]), np.array([2, 3])
    assert np.median(speed[:, patients][on_stair[:, patients]]) == pytest.approx(0.84 * slope, rel=0.03)
    flat = (level[:-1] == 0)[:, patients] & (position[:-1, patients, 0] > 3.0)
    assert speed[:, patients][flat].max() < 1.32
    moves = (speed[:, patients] > 0.2).any(axis=1)
    apart = position[:-1, patients, None] - position[:-1, None, staff]
    same = level[:-1, patients, None] == level[:-1, None, staff]
    nearest = np.where(same, np.hypot(apart[..., 0], apart[..., 1]), 0.0).min(axis=2)[moves]
    assert nearest.max() < 3.5
    notes = simulation.results().notes
    assert [note.split(" by ")[0] for note in notes] == [
        "helpers: person 0 was fetched",
        "helpers: person 1 was fetched",
    ]


def test_nobody_moves_before_the_helpers_have_come_and_prepared():
    simulation, position, _ = run(ward())
    (note,) = simulation.results().notes
    begin = float(note.split(" at ")[1].split(" s")[0])
    before = position[: round(10.0 * (begin + 9.5)), 0]
    assert np.hypot(*(before - before[0]).T).max() < 0.3
    assert begin > 5.0


def test_helpers_return_from_an_assembly_area_for_the_next_one():
    """The run goes on while they go and prepare, and nobody walls them in."""
    case = ward(HALL, patients={"number": 2}, staff={"number": 1}, to="hall", preparation=30.0)
    simulation, _, _ = run(case.change({"simulation.no_progress": 12.0}))
    (place,) = simulation.results().places
    assert place.people == (0, 1)
    assert simulation.ended == "everybody out or at a safe place"
    assert np.isfinite(simulation.population.crowd.exit_time[2])


def test_people_are_brought_to_a_refuge_that_has_room_for_them():
    lobby = {"name": "lobby", "kind": "refuge", "area": "lobby", "capacity": 2}
    simulation, position, level = run(ward(lobby, patients={"number": 2}, to="lobby"))
    (refuge,) = simulation.results().places
    assert refuge.people == (0, 1)
    assert (level[-1, :2] == simulation.building.level_named("high").index).all()
    assert (position[-1, :2, 0] < 23.1).all()
    assert np.isfinite(simulation.population.crowd.exit_time[2:]).all()
    with pytest.raises(evac.EvacError, match="has room for 2"):
        simulation_of(ward(lobby, patients={"number": 3}, to="lobby"))


def test_two_carry_one():
    simulation, _, _ = run(ward(device="carry"))
    assert simulation.ended == "everybody out"
    assert "person 0 was fetched by 1, 2 at" in simulation.results().notes[0]


def test_a_helper_pushes_a_wheelchair_over_a_ramp_and_no_stair():
    own, fetch = {"helpers": {"device": "push"}}, {"helpers": {"fetches": "patients"}}
    people = [
        {"name": "patients", "preset": "wheelchair", "area": "start", "number": 1, "behaviours": own},
        {"name": "staff", "area": "start", "number": 1, "behaviours": fetch},
    ]
    content = {"building": two_ways(), "people": people, "contact": {"model": "nsm2"}}
    behaviours = {"walking": {}, "helpers": {"areas": ["start"], "preparation": 1.0}}
    simulation, position, level = run(evac.load(content | {"behaviours": behaviours}))
    assert simulation.ended == "everybody out"
    assert not np.isin(level[:, 0], simulation.building.stairs["stairs"]).any()
    on_ramp = (level[1:, 0] == level[:-1, 0]) & np.isin(level[1:, 0], simulation.building.stairs["ramp"])
    speed = np.hypot(*np.diff(position[:, 0], axis=0).T) / 0.1
    assert speed[on_ramp].max() == pytest.approx(1.3, rel=0.02)


def test_nobody_is_fetched_whom_the_device_cannot_bring_all_the_way():
    case = ward(device="evacuation_chair", to="lobby", areas=["office"], patients={"area": "office"}).to_dict()
    case["place"] = [{"name": "lobby", "kind": "assembly", "area": "lobby"}]  # upstairs
    simulation, _, _ = run(evac.load(case).change({"simulation.no_progress": 5.0}))
    assert simulation.results().notes == ("helpers: person 0 was not fetched",)


def test_people_in_wheelchairs_are_fetched_from_their_refuge():
    refuge = {"name": "lobby", "kind": "refuge", "area": "lobby"}
    case = ward(refuge, patients={"preset": "wheelchair", "number": 2}, areas=["lobby"])
    simulation, position, _ = run(case)
    assert simulation.ended == "everybody out"
    assert all(note.endswith("out or there") for note in simulation.results().notes)
    x, y = position[:, 0].T
    assert ((x > 20) & (x < 23) & (y > 7)).any()


def test_own_devices_have_own_speeds():
    devices = {"sledge": {"flat": 0.5, "up": 0.1, "down": 0.4, "handlers": 1}}
    simulation, position, level = run(ward(device="sledge", devices=devices))
    speed = np.hypot(*np.diff(position[:, 0], axis=0).T) / 0.1
    flat = (level[1:, 0] == 0) & (position[1:, 0, 0] > 2.0)
    assert speed[flat].max() < 0.52
    assert (simulation.population.crowd.speed[0, FLAT] > 1.0).all()


def test_who_cannot_be_reached_is_told_of():
    case = ward().change({"building.closed": ["stairs"], "simulation.no_progress": 5.0})
    case = case.change({"people.patients.speed": 1.0})
    with pytest.raises(evac.EvacError, match=r"people\.patients"):  # nobody upstairs has a way out
        simulation_of(case)
    event = {"time": 1.0, "kind": "close", "target": "stairs"}
    open_case = ward().change({"simulation.no_progress": 5.0}).to_dict() | {"event": [event]}
    simulation, _, _ = run(evac.load(open_case))
    notes = simulation.results().notes
    assert "helpers: person 0 was not fetched" in notes
    assert [note.partition(":")[0] for note in notes if "'stairs' closed at 1 s" in note] == [
        "people.patients",
        "people.staff",
    ]


def test_a_helper_who_is_still_needed_returns_from_the_exit():
    simulation, _, _ = run(ward(patients={"number": 2}, staff={"number": 1}))
    assert simulation.ended == "everybody out"
    out = simulation.population.crowd.exit_time
    assert out[2] > out[1] - 3.0
    assert all(" by 2 at " in note for note in simulation.results().notes)


def rooms(area):
    """Return a case of two rooms with a patient in one of them, and a helper who starts near it in the other one."""
    plan = evac.Plan()
    plan.storey("floor", [box(0, 0, 7.8, 5), box(8, 0, 16, 5), box(0, 5.2, 16, 8)])
    plan.door("west", "floor", [(1, 5.1), (2.2, 5.1)])
    plan.door("east", "floor", [(13, 5.1), (14.2, 5.1)])
    plan.exit("out", "floor", [(0, 6), (0, 7.2)])
    plan.area("room", "floor", box(0, 0, 7.8, 5))
    plan.area("both", "floor", box(0, 0, 16, 8))
    own, fetch = {"helpers": {"device": "support"}}, {"helpers": {"fetches": "patients"}}
    people = [
        {"name": "patients", "level": "floor", "positions": [[6.0, 3.0]], "behaviours": own},
        {"name": "staff", "level": "floor", "positions": [[10.0, 3.0]]} | {"behaviours": fetch},
    ]
    behaviours = {"walking": {}, "helpers": {"areas": [area], "preparation": 1.0}}
    simulation = {"duration": 120.0, "no_progress": 15.0}
    tables = {"building": plan, "people": people, "contact": {"model": "nsm1"}, "behaviours": behaviours}
    return simulation_of(evac.load(tables | {"simulation": simulation}))


def test_a_helper_near_a_person_behind_a_wall_goes_through_the_doors():
    assert rooms("room").run().ended == "everybody out"


def test_areas_of_several_rooms_are_refused_with_a_door_in_them():
    with pytest.raises(evac.EvacError, match=r"behaviours\.helpers\.areas: 'both' .* 'west'"):
        rooms("both")
