"""Doors that let people through one after the other, so many, or when their leaves open; stairs that nobody enters."""

import numpy as np
import pytest
from shapely import box

import evac
from evac.report.sections import building_section
from evac.simulation.shared import simulation_of


def hall(control=None, *events, kind="exit", people=12, **changes):
    """Return a case of two storeys whose ways all lead through one link: an exit, a door, or a stair of one flight."""
    plan = evac.Plan()
    own = {one: control if one == kind else None for one in ("exit", "door")}
    plan.storey("ground", [box(0, 0, 8, 6), box(8.2, 0, 14, 6)])
    plan.storey("first", box(18, 0, 28, 6), z=2.0)
    plan.stair("stair", "ground", [(14, 2), (14, 4)], "first", [(18, 2), (18, 4)])
    plan.door("door", "ground", [(8.1, 2), (8.1, 4)], control=own["door"])
    plan.exit("exit", "ground", [(0, 2), (0, 4)], control=own["exit"])
    plan.area(
        "start",
        *{"exit": ("ground", box(3, 1, 7, 5)), "door": ("ground", box(9, 1, 13, 5))}.get(
            kind, ("first", box(19, 1, 24, 5))
        ),
    )
    table = {
        "building": plan,
        "contact": {"model": "nsm1"},
        "simulation": {"duration": 60.0, "no_progress": 20.0},
        "people": [{"name": "p", "number": people, "area": "start", "speed": 1.3, "radius": 0.2}],
        "event": list(events),
    }
    portal = plan.building().portals[-1].name if kind == "stair" else ""
    controls = {"building.controls": {portal: control}} if portal and control else {}
    return evac.load(table, changes | controls)


def event(kind, target, time, **values):
    return {"kind": kind, "target": target, "time": time} | values


def passages(case, kind="exit"):
    """Return the results and the times at which people pass the link, in order."""
    results = simulation_of(case).run()
    _, portal, time = results.crossings
    if kind == "exit":
        return results, np.sort(results.crowd.exit_time[np.isfinite(results.crowd.exit_time)])
    return results, np.sort(time[portal == results.building.portals[-1].index])


@pytest.mark.parametrize("kind", ["exit", "stair"])
def test_a_meter_lets_one_person_through_in_its_time_and_nobody_is_lost(kind):
    results, times = passages(hall({"every": 2.0}, kind=kind), kind)
    assert results.ended == "everybody out"
    assert len(times) == 12
    assert np.diff(times).min() >= 2.0 - 0.1  # people behind may push for a tick
    assert np.diff(times).max() < 2.5
    after = times[0] + np.array([9.9, 15.9, 21.9])  # it opens up to two ticks late
    assert np.searchsorted(times, after).tolist() == [5, 8, 11]


def test_so_many_people_pass_a_door_and_the_others_are_named_with_the_event_that_shut_them_in():
    for kind in ("exit", "door"):
        results, _ = passages(hall({"most": 5}, kind=kind))
        assert results.evacuated == 5
        (change,) = results.changes
        assert (change.kind, change.what) == ("close", kind)
        passed = {*np.flatnonzero(np.isfinite(results.crowd.exit_time)).tolist()}
        assert {*change.values.get("let_through", ())} <= passed  # they were on its line
        lost = np.flatnonzero(np.isnan(results.crowd.exit_time)).tolist()
        (line,) = results.notes
        for word in ("7 people", "'ground'", f"'{kind}' closed at {change.time:g} s", ", ".join(map(str, lost))):
            assert word in line
        assert line in results.answer.remarks


def test_a_leaf_opens_after_its_delay_and_closes_behind_the_last_one():
    one = {"people.p.area": None, "people.p.number": None, "people.p.level": "ground", "simulation.no_progress": 5.0}
    case = hall({"delay": 3.0, "hold": 2.0}, **one | {"people.p.positions": [[3.0, 3.0], [14.0, 3.0]]})
    free = simulation_of(case.change({"building.plan.exits.exit.control": {"delay": 0.0}})).run().crowd.exit_time
    time = simulation_of(case).run().crowd.exit_time
    assert time[0] - free[0] == pytest.approx(3.0, abs=0.9)  # who has come stands, and starts from rest
    assert time[1] - free[1] == pytest.approx(3.0, abs=0.9)  # it has closed behind the first one
    stays = case.change({"building.plan.exits.exit.control": {"delay": 3.0}})
    assert simulation_of(stays).run().crowd.exit_time[1] == pytest.approx(free[1], abs=1e-9)


def test_controls_are_recorded_written_and_shown(tmp_path):
    events = event("control", "exit", 1.0, value={"every": 3.0}), event("control", "exit", 5.0, value=False)
    results = evac.run(hall({"every": 2.0, "most": 40}, *events, people=6), tmp_path / "r", progress=False)
    trajectory = evac.read_trajectory(tmp_path / "r")
    words = "one person in 2 s, closes after 40 people"
    assert trajectory.building.label_of(trajectory.building.exits[0]) == "exit (controlled)"
    assert [str(control) for control in trajectory.building.controlled.values()] == [words]
    assert trajectory.building_at(5.0).controls == frozenset()
    assert f"open; {words}" in str(building_section(evac.Results.read(tmp_path / "r")))
    told = ["'exit' controlled: one person in 3 s at 1 s", "'exit' without control at 5 s"]
    assert [str(change) for change in results.changes] == told
    assert results.last_out < 10.0
    plan = evac.Plan()
    plan.storey("g", box(0, 0, 9, 5))
    plan.storey("u", box(14, 0, 20, 5), z=3.0)
    plan.exit("e", "g", [(0, 1), (0, 3)], control={"delay": 2.0})
    plan.stair("s", "g", [(9, 1), (9, 2.6)], "u", [(14, 1), (14, 2.6)], handrails=0.15)
    plan.write(tmp_path / "a.plan.toml")
    read = evac.read_building(tmp_path / "a.plan.toml")
    assert str(read.controlled[read.link_of(read.exits[0])]) == "opens after 2 s"
    assert [portal.width for portal in read.portals] == pytest.approx([1.3, 1.3])


@pytest.mark.parametrize("target", ["stair", "first"])
def test_nobody_enters_and_those_inside_go_on(target):
    """People on both storeys have an exit on the other one: who is in what is closed leaves it, nobody comes in."""
    side = {"name": "side", "segment": [[28, 2], [28, 4]], "z": 2.0}
    below = {"name": "q", "number": 6, "area": "low", "speed": 1.3, "exits": ["side"]}
    low = {"name": "low", "polygon": [[9, 1], [13, 1], [13, 5], [9, 5]], "z": 0.0}
    case = hall(
        None, event("no_entry", target, 6.0), kind="stair", **{"building.exits": [side], "building.areas": [low]}
    )
    people = [one.model_dump(exclude_unset=True) for one in case.people]
    case = case.change({"people": [people[0] | {"exits": ["exit"]}, below]})
    simulation = simulation_of(case)
    inside = {one.level for one in simulation.building.parts_named(target)}
    before = simulation.population.crowd.level.copy()
    while not simulation.ended:
        simulation.advance_tick()
        level = simulation.population.crowd.level
        entered = np.isin(level, [*inside]) & ~np.isin(before, [*inside])
        assert simulation.time < 6.3 or not entered.any()
        before = level.copy()
    assert simulation.ended == "everybody out"


def test_who_is_on_a_stair_that_closes_leaves_it_or_is_shut_in():
    outcome = {}
    for value in ({}, {"value": "all"}):
        results = simulation_of(hall(None, event("close", "stair", 7.0, **value), kind="stair")).run()
        flight = results.building.pieces_of("stair")
        outcome[bool(value)] = results.evacuated, int(np.isin(results.crowd.level, flight).sum())
        assert results.building.closed
        assert not results.building.one_way
        assert any(
            "on 'stair' cannot reach any exit any more because of: 'stair' closed at 7 s" in line
            for line in results.notes
        ) == bool(value)
        (held,) = [
            line for line in results.remarks if "'stair' closed at 7 s" in line and "without progress" in line
        ] or [""]
        assert bool(held) == bool(value)
    assert outcome[False][1] == 0
    assert outcome[True][1] > 0
    assert outcome[False][0] >= outcome[True][0] + outcome[True][1]


def test_what_cannot_be_controlled_so_is_refused():
    with pytest.raises(evac.EvacError, match=r"controls\.gate.*'gate'|'gate'"):
        simulation_of(hall(**{"building.controls": {"gate": {"every": 1.0}}}))
    with pytest.raises(evac.EvacError, match=r"building\.controls\.exit\.every"):
        hall(**{"building.controls": {"exit": {"every": 0.0}}})
    with pytest.raises(evac.EvacError, match=r"event\.0\.value"):
        hall(None, event("control", "exit", 1.0, value={"ever": 1.0}))
    with pytest.raises(evac.EvacError, match="start"):
        simulation_of(hall(None, event("no_entry", "start", 1.0)))


@pytest.mark.parametrize(("post", "control"), [(0.1, {"delay": 1.0, "hold": 1.0}), (0.2, {"every": 2.0})])
def test_who_stands_between_two_controlled_doors_passes_the_nearer_one(post, control):
    """The other door let this person through, tick after tick, and kept it from its own."""
    plan = evac.Plan()
    plan.storey("g", [box(0, 0, 10, 6), box(10.2, 0, 16, 6)])
    for name, y in (("a", 2.0), ("b", 2.9 + post)):
        plan.door(name, "g", [(10.1, y), (10.1, y + 0.9)], control=control)
    plan.exit("exit", "g", [(16, 2), (16, 4)])
    plan.area("start", "g", box(4, 1, 8, 5))
    people = [{"name": "p", "number": 12, "area": "start", "speed": 1.3, "radius": 0.2}]
    simulation = {"duration": 60.0, "seed": 1, "no_progress": 10.0}
    case = evac.load({"building": plan, "contact": {"model": "nsm1"}, "people": people, "simulation": simulation})
    assert simulation_of(case).run().ended == "everybody out"
