"""Rides in lifts: a car is called, people walk in, ride and walk out; as many as there are places, and not one more."""

import numpy as np
import pytest
import pyvista
from shapely import box

import evac
from evac.base.errors import EvacError
from evac.building.model.lifts import Motion
from evac.export.vtk import export_vtk
from evac.pictures.map_pictures import draw_map
from evac.pictures.palette import CAR, rgb
from evac.pictures.render import Renderer
from evac.replay.writer import cars_for_page, packed
from evac.simulation.lifts import CLOSING, OPEN, OPENING, RIDES
from evac.simulation.shared import simulation_of
from tests.runs import assert_same_bits, run_ticks


def tower(heights=(0.0, 20.0), cars=1, stair=False, **operation):
    """A plan with storeys s0, s1, ... and cars beside each other behind their right walls."""
    plan = evac.Plan()
    for k, z in enumerate(heights):
        plan.storey(f"s{k}", box(0, 0, 10, 6), z=z)
        if stair and k:
            x = 1.0 + 3.2 * (k % 2)
            lower, upper = [(x, 0), (x + 1.2, 0)], [(x + 1.3, 0), (x + 2.5, 0)]
            plan.stair(f"stair {k}", f"s{k - 1}", lower, f"s{k}", upper, length=3.0, direction=(0, -1))
    plan.exit("door", "s0", [(0, 2), (0, 4)])
    for car in range(cars):
        y = 6.0 / cars * (car + 0.5)
        door = [(10.2, y - 0.45), (10.2, y + 0.45)]
        own = operation if cars == 1 else operation | {"bank": "cars"}
        plan.lift(
            f"lift {car}",
            [f"s{k}" for k in range(len(heights))],
            box(10.2, y - 0.8, 11.6, y + 0.8),
            door,
            operation=own,
        )
    return plan


def case(plan, people, model="nsm2", **changes):
    table = {"building": plan, "people": people, "contact": {"model": model}, "behaviours": {"walking": {}}}
    return evac.load(table | {"directions": {"spacing": 0.2}, "simulation": {"duration": 900.0}}, changes)


def group(number, level, **more):
    return {"name": f"from {level}", "number": number, "level": level, "lifts": "preferred"} | more


def assert_goes_on(whole, resumed):
    """Compare what a run and one that was resumed have come to."""
    if resumed is not None:
        assert_same_bits(whole, resumed)
        assert whole.scene.changes == resumed.scene.changes
        np.testing.assert_array_equal(whole.lifts.rides, resumed.lifts.rides)


#: Doors and motion of the shuttle whose times are stated: 40 people, 20 m, a car of 10.
SHUTTLE = {
    **{"speed": 2.5, "acceleration": 1.0, "jerk": 1.2, "start_delay": 0.0},
    **{"capacity": 10, "start": "s1", "dwell": 3.0},
}


def watched(simulation):
    """Run to the end; check at each tick that cars are not too full, and that nobody is where no car is."""
    lifts = simulation.building.lifts
    while not simulation.ended:
        simulation.advance_tick()
        crowd = simulation.population.crowd
        for k, lift in enumerate(lifts):
            inside = [np.flatnonzero(crowd.level == room) for room in lift.rooms]
            assert all(not len(rows) for stop, rows in enumerate(inside) if stop != simulation.lifts.stop[k])
            rows = inside[simulation.lifts.stop[k]]
            assert len(rows) <= lift.operation.capacity
            assert np.pi * (crowd.radius[rows] ** 2).sum() <= simulation.building.levels[lift.rooms[0]].polygon.area
            assert lift.operation.load is None or crowd.mass[rows].sum() <= lift.operation.load
    return simulation


def test_a_person_calls_the_car_rides_and_walks_out_in_the_time_of_walk_flight_and_doors():
    person = {"name": "one", "positions": [[5.0, 3.0]], "level": "s1", "speed": 1.0, "lifts": "preferred"}
    simulation = watched(simulation_of(case(tower((0.0, 3.5)), [person])))
    flight = Motion(3.5, 1.0, 0.8, 1.0).duration
    times = [change.time for change in simulation.scene.changes]
    # called, then flight with its delay, opening; walk in; dwell and closing; flight; opening
    assert times[1] - times[0] == pytest.approx(0.5 + flight, abs=0.11)
    assert times[2] - times[1] == pytest.approx(2.0, abs=0.11)
    assert times[4] - times[3] == pytest.approx(3.0, abs=0.11)
    assert times[5] - times[4] == pytest.approx(0.5 + flight, abs=0.11)
    assert times[6] - times[5] == pytest.approx(2.0, abs=0.11)
    assert simulation.ended == "everybody out"
    (exit_time,) = simulation.population.crowd.exit_time
    assert exit_time - times[6] == pytest.approx(10.0, abs=2.5)  # from the back of the car to the exit at 1 m/s
    _, links, _ = simulation.population.crossings
    assert [simulation.building.links[link].kind for link in links.tolist()] == ["portal", "ride", "portal"]


def last_out(lift, transfers):
    """Return by hand when a car that starts above has let its last people out, by the times of getting in and out."""
    own, flight = lift.operation, lift.flight(1, 0)
    return sum(own.opening + time + own.closing + flight for time in transfers) - own.closing - flight


def test_a_shuttle_makes_no_extra_trip_and_its_time_is_that_of_the_hand_calculation_with_measured_transfers():
    """With one second for each person in and out, the calculation gives the times that are stated: 40 people."""
    simulation = watched(simulation_of(case(tower(cars=2, **SHUTTLE), [group(40, "s1")], "nsm1")))
    trips, changes = simulation.lifts.trips, simulation.scene.changes
    assert trips[:, 4].tolist() == [10.0] * 4
    hands = []
    for lift in simulation.building.lifts:
        assert last_out(lift, [10.0] * 8) == pytest.approx(196.33, abs=0.005)  # by one car
        assert last_out(lift, [10.0] * 4) == pytest.approx(91.0, abs=0.005)
        own = [(change.values["value"][0], change.time) for change in changes if change.what == lift.name]
        opened, closed = ([time for what, time in own if what == kind] for kind in ("opens at", "closes at"))
        hands.append(last_out(lift, np.subtract(closed, opened)))
    last = max(change.time for change in changes if change.values["value"][0] == "closes at")
    assert last == pytest.approx(max(hands), abs=2.0)


def test_people_are_called_to_the_door_of_a_car_of_a_bank_before_it_arrives():
    """All wait before the uppermost of three doors; when the three cars open theirs, somebody stands before each."""
    places = np.stack(np.meshgrid(np.linspace(8.2, 9.7, 4), np.linspace(4.0, 5.7, 4)), axis=-1).reshape(-1, 2).tolist()
    people = {"name": "crowd", "level": "s1", "positions": places, "lifts": "preferred"}
    simulation = simulation_of(case(tower(cars=3, capacity=6), [people], "nsm1"))
    crowd, lobby = simulation.population.crowd, simulation.building.level_named("s1").index
    while not (is_open := (simulation.lifts.phase == OPEN) & (simulation.lifts.stop == 1)).any():
        simulation.advance_tick()
    assert is_open.all()
    before = crowd.position[crowd.level == lobby]
    assert all(np.hypot(*(before - (10.0, y)).T).min() < 1.0 for y in (1.0, 3.0, 5.0))
    simulation.advance_tick()
    assert len({*crowd.passing.tolist()} - {-1}) == 3  # each car lets its own people in
    watched(simulation)
    assert sorted(simulation.lifts.trips[:, 4].tolist()) == [4.0, 6.0, 6.0]


def test_people_near_two_lifts_wait_for_the_one_to_whose_door_they_walk():
    """Each lift is a bank of its own; the second one has two places, and its way is nearly as quick."""
    plan = evac.Plan()
    for k in range(2):
        plan.storey(f"s{k}", box(0, 0, 10, 6), z=4.0 * k)
    plan.exit("door", "s0", [(0, 2), (0, 4)])
    for y in (1.5, 4.5):
        own = {"capacity": 7, "speed": 2.5} if y < 3.0 else {"capacity": 2, "speed": 1.0, "start": "s1"}
        ground, door = box(10.2, y - 0.8, 11.6, y + 0.8), [(10.2, y - 0.45), (10.2, y + 0.45)]
        plan.lift(f"lift {y}", ["s0", "s1"], ground, door, operation={**own, "dwell": 1.0, "wait": 30.0})
    people = {"name": "all", "level": "s1", "lifts": "preferred", "positions": [[9.3, 0.8 + 0.6 * k] for k in range(4)]}
    simulation = watched(simulation_of(case(plan, [people], behaviours={})))
    assert simulation.ended == "everybody out"


def test_a_full_car_leaves_the_others_waiting_by_persons_and_by_load():
    people = [group(6, "s1", mass=80.0)]
    by_persons = watched(simulation_of(case(tower((0.0, 4.0), capacity=4), people)))
    assert by_persons.lifts.trips[:, 4].tolist() == [4.0, 2.0]
    by_load = watched(simulation_of(case(tower((0.0, 4.0), load=250.0), people)))
    assert by_load.lifts.trips[:, 4].tolist() == [3.0, 3.0]
    use = by_load.results().lifts[0]
    assert (use["trips"], use["people"]) == (2, 6)
    assert 0.0 < use["mean_wait"] < use["longest_wait"] < use["last_ride"]
    by_hand = 1.1 * 2 * (2.0 * (by_load.building.lifts[0].flight(0, 1) + 5.0) + 8.0)  # 4 s at least, in and out
    assert by_persons.results().lifts[0]["by_hand"] == pytest.approx(by_hand)


def test_only_those_who_ride_get_in_and_who_cannot_use_stairs_rides():
    wheelchairs = group(3, "s2", name="wheelchairs", steepest=0.0, lifts=None)
    people = [group(6, "s2", lifts=""), wheelchairs, group(8, "s1", lifts="weighed")]
    simulation = watched(simulation_of(case(tower((0.0, 4.0, 8.0), stair=True), people)))
    assert simulation.ended == "everybody out"
    rode = {int(row) for row in simulation.lifts.rides[:, 0]}
    names = [one.name for one in simulation.case.people]
    of = [names[row] for row in simulation.population.crowd.group[[*rode]].tolist()]
    assert of == ["wheelchairs"] * 3  # the others are quicker by stairs than the 30 s that one expects to wait


@pytest.mark.parametrize(("capacity", "others", "trips"), [(1, 0, 2), (8, 7, 2)])
def test_wheelchairs_take_the_ground_that_they_need_and_block_no_car(capacity, others, trips):
    wide = group(2, "s1", name="wheelchairs", radius=0.4, turns=False, steepest=0.0, lifts=None)
    people = [wide, *([group(others, "s1")] if others else [])]
    simulation = watched(simulation_of(case(tower((0.0, 4.0), capacity=capacity), people, "nsm1")))
    assert simulation.ended == "everybody out"
    assert len(simulation.lifts.rides) == 2 + others
    assert len(simulation.lifts.trips) >= trips


def test_who_uses_no_stairs_and_is_pushed_onto_one_walks_back_and_rides():
    people = group(2, "s2", name="wheelchairs", radius=0.3, turns=False, steepest=0.0, lifts=None)
    simulation = simulation_of(case(tower((0.0, 4.0, 8.0), stair=True), [people], "nsm1"))
    crowd, landing = simulation.population.crowd, simulation.building.level_named("stair 2 landing z=6.00")
    with simulation.population.writable():
        crowd.level[0], crowd.position[0] = landing.index, (2.6, -3.6)
    watched(simulation)
    assert simulation.ended == "everybody out"
    assert sorted(simulation.lifts.rides[:, 0].tolist()) == [0.0, 1.0]


@pytest.mark.parametrize("closes", [False, True])
def test_people_leave_a_refuge_as_soon_as_a_lift_runs(closes):
    plan = tower((0.0, 4.0), stair=True, service=closes)
    plan.area("lobby", "s1", box(8, 1, 9.9, 5))
    wide = group(2, "s1", name="wheelchairs", radius=0.4, turns=False, steepest=0.0, lifts=None)
    events = [{"time": 20.0, "kind": "open", "target": "lift 0"}]
    events += [{"time": 2.0, "kind": "close", "target": "lift 0"}] if closes else []
    place = [{"name": "refuge", "kind": "refuge", "area": "lobby"}]
    simulation = simulation_of(case(plan, [wide], "nsm1", event=events, place=place))
    run_ticks(simulation, round(19.0 / simulation.case.simulation.tick))
    assert simulation.places.arrived.all()
    assert watched(simulation).ended == "everybody out"
    assert (simulation.lifts.trips[:, 1] > 20.0).all()


def test_who_weighs_lifts_is_not_later_than_by_stairs():
    plan = tower(tuple(4.0 * storey for storey in range(4)), 2, stair=True, speed=2.5, capacity=8, wait=0.0)
    runs = {}
    for strategy, lifts in [("fastest", ""), ("quickest", "weighed")]:
        people = [group(12, f"s{storey}", strategy=strategy, lifts=lifts) for storey in range(1, 4)]
        runs[strategy, lifts] = simulation = watched(simulation_of(case(plan, people, "nsm1")))
        assert simulation.ended == "everybody out"
        rode = simulation.lifts.rides[:, 0].astype(int)
        by_stairs = runs["fastest", ""].population.crowd.exit_time
        assert simulation.population.crowd.exit_time.mean() <= by_stairs.mean()
        if lifts:
            assert 0 < len(rode) < 36
            assert simulation.population.crowd.exit_time[rode].mean() <= by_stairs[rode].mean()


@pytest.mark.parametrize("cars", [1, 2])
def test_the_expected_wait_is_that_of_the_trips_for_all_on_the_way(cars):
    """Trips by hand: the highest storey first, each by the car that is back first."""
    operation = SHUTTLE | {"start": "s0", "opening": 2.0, "closing": 3.0, "wait": 0.0}
    plan = tower((0.0, 10.0, 20.0), cars, **operation)
    simulation = simulation_of(case(plan, [group(1, "s2", strategy="quickest", lifts="weighed")]))
    lifts, on_way = simulation.building.lifts, np.zeros(len(simulation.building.levels), np.int32)
    for people, stop in [(25, 2), (4, 1)]:
        on_way[[lift.rooms[stop] for lift in lifts]] = np.diff(np.linspace(0, people, cars + 1).astype(int))
    ride = {stop: Motion(10.0 * stop, 2.5, 1.0, 1.2).duration for stop in (1, 2)}
    free, waits = [0.0] * cars, {}
    for stop, load in [(2, 10), (2, 10), (2, 5), (1, 4)]:
        waits[stop] = min(free) + ride[stop] + 2.0
        free[free.index(min(free))] += 2.0 * (ride[stop] + 2.0 + 3.0 + max(4.0, load))
    found = simulation.scene.waits_for_lifts(on_way)
    assert found == pytest.approx({lift.rooms[stop]: waits[stop] for lift in lifts for stop in (1, 2)})


def test_those_are_on_the_way_to_a_lift_who_climb_to_it():
    plan = evac.Plan()
    for k in range(3):
        plan.storey(f"s{k}", box(0, 0, 10, 6), z=4.0 * k)
    plan.stair("up", "s1", [(1.0, 0), (2.2, 0)], "s2", [(2.3, 0), (3.5, 0)], length=3.0, direction=(0, -1))
    plan.lift("lift", ["s0", "s2"], box(10.2, 2.2, 11.6, 3.8), [(10.2, 2.55), (10.2, 3.45)])
    plan.exit("door", "s0", [(0, 2), (0, 4)])
    people = [group(6, "s1", lifts="weighed"), group(2, "s2"), group(3, "s0", lifts="")]
    simulation, seen = simulation_of(case(plan, people, "nsm1")), []
    waits = simulation.scene.waits_for_lifts
    simulation.scene.waits_for_lifts = lambda on_way: (seen.append(on_way.tolist()), waits(on_way))[1]
    assert watched(simulation).ended == "everybody out"
    upper = simulation.building.lifts[0].rooms[1]
    assert seen[0][upper] == 8 == sum(seen[0])
    assert len(simulation.lifts.rides) == 8
    assert sum(seen[-1]) == 0


def test_helpers_bring_people_by_lift_also_if_the_car_parts_them():
    plan = tower((0.0, 4.0), stair=True, capacity=1)
    plan.area("ward", "s1", box(5, 1, 8, 5))
    patients = {
        **{"name": "patients", "level": "s1", "positions": [[6.0, 3.0]], "radius": 0.4, "turns": False},
        **{"steepest": 0.0, "behaviours": {"helpers": {"device": "push"}}},
    }
    staff = group(1, "s1", name="staff", lifts="", behaviours={"helpers": {"fetches": "patients"}})
    helpers = {"areas": ["ward"], "preparation": 3.0, "lifts": "weighed"}
    scene = case(plan, [patients, staff], "nsm1", behaviours={"walking": {}, "helpers": helpers})
    simulation = watched(simulation_of(scene))
    assert simulation.ended == "everybody out"
    assert sorted(simulation.lifts.rides[:, 0].tolist()) == [0.0, 1.0]
    assert len(simulation.lifts.trips) == 2


def test_a_car_takes_people_up_to_their_goals_while_others_go_down():
    """Each ride up has one goal; who starts above the discharge rides there first; the same bits from a ride up on."""
    plan = tower((0.0, 4.0, 8.0, 12.0), stair=True, speed=2.5)
    plan.area("post", "s3", box(1, 4, 3, 6))
    plan.area("low", "s1", box(1, 4, 3, 6))
    place = [
        {"name": "command", "kind": "assembly", "area": "post"},
        {"name": "aid", "kind": "assembly", "area": "low"},
    ]
    limited = {"assembly": ["aid"], "steepest": 0.0}
    people = [
        group(3, "s0", name="firefighters", assembly=["command"]),
        group(2, "s0", name="chairs", **limited),
        group(1, "s2", name="above", **limited | {"assembly": ["command"]}),
        group(6, "s2", name="others"),
    ]
    scene = case(plan, people, "nsm1", place=place)
    whole, resumed, ticks = simulation_of(scene), None, 0
    while not whole.ended:
        whole.advance_tick()
        if resumed is None and len(whole.lifts.trips) and whole.lifts.phase[0] == RIDES:
            resumed = simulation_of(scene)
            resumed.restore(whole.state())
        elif resumed is not None and ticks < 300:
            resumed.advance_tick()
            ticks += 1
            if ticks == 300:
                assert_goes_on(whole, resumed)
    assert ticks == 300
    assert whole.ended == "everybody out or at a safe place"
    assert {place.name: len(place.people) for place in whole.results().places} == {"command": 4, "aid": 2}
    names, rode = [one.name for one in whole.case.people], whole.lifts.rides[:, 0].astype(int)
    of_group = [names[k] for k in whole.population.crowd.group[rode]]
    assert (len(of_group), of_group.count("above")) == (13, 2)
    assert {*map(tuple, whole.lifts.trips[:, 2:4].tolist())} == {(0.0, 1.0), (0.0, 3.0), (2.0, 0.0)}
    assert whole.lifts.trips[0, 2] == 0.0  # those at the discharge first: the car is there


#: Spacing, and times while they walk to the lift, and ride.
@pytest.mark.parametrize(("spacing", "at"), [(0.2, 3.0), (0.3, 30.0)])
def test_who_rides_up_as_the_lift_goes_out_of_service_gets_out_and_takes_the_stairs(spacing, at):
    plan = tower((0.0, 4.0), stair=True, speed=0.2)
    plan.area("post", "s1", box(1, 4, 3, 6))
    place = [{"name": "command", "kind": "assembly", "area": "post"}]
    fire = group(2, "s0", name="firefighters", assembly=["command"])
    event = {"kind": "close", "target": "lift 0", "time": at}
    changes = {"directions.spacing": spacing}
    simulation = watched(simulation_of(case(plan, [fire], "nsm1", place=place, event=[event], **changes)))
    assert simulation.ended == "everybody out or at a safe place"
    assert len(simulation.results().places[0].people) == 2


def test_smoke_in_a_lobby_recalls_a_lift():
    plan = tower((0.0, 4.0), stair=True)
    plan.area("lobby", "s1", box(8, 1, 9.9, 5))
    event = {"when": {"smoke": 0.5, "area": "lobby"}, "kind": "close", "target": "lift 0"}
    growing = {"source": "prescribed", "times": [0, 20], "values": {"extinction": [0, 1]}, "hold": True}
    scene = case(plan, [group(20, "s1")], event=[event], conditions=[growing], smoke={"routes": False})
    simulation = watched(simulation_of(scene))
    (change,) = [change for change in simulation.scene.changes if change.kind == "close"]
    assert 10.0 <= change.time <= 12.1  # the air is looked at every 2 s
    assert simulation.ended == "everybody out"
    assert (simulation.lifts.trips[:, 1] < change.time + 30.0).all()
    assert len(simulation.lifts.rides) < 20
    with pytest.raises(EvacError, match=r"when\.smoke: "):
        simulation_of(case(plan, [group(1, "s1")], event=[event]))


def test_who_stands_in_the_niche_of_another_door_walks_round_its_posts_to_the_car_that_comes():
    plan = evac.Plan()
    for k in range(2):
        plan.storey(f"s{k}", box(0, 0, 10, 20), z=4.0 * k)
    plan.exit("door", "s0", [(0, 2), (0, 4)])
    for car, y in enumerate((18.0, 2.0)):
        door, ground = [(10.2, y - 0.55), (10.2, y + 0.55)], box(10.2, y - 0.8, 11.6, y + 0.8)
        plan.lift(f"lift {car}", ["s0", "s1"], ground, door, operation={"bank": "cars"})
    person = {"name": "one", "positions": [[10.05, 2.3]], "level": "s1", "radius": 0.15, "lifts": "preferred"}
    simulation = watched(simulation_of(case(plan, [person])))
    assert simulation.ended == "everybody out"
    assert simulation.lifts.trips[:, 0].tolist() == [0.0]  # the first car that came, not another one after it


def test_who_is_too_heavy_for_a_car_lets_the_others_pass_and_who_is_for_all_is_named_before_the_run():
    heavy = {"name": "heavy", "level": "s1", "mass": 200.0, "positions": [[9.6, 3.0]], "lifts": "preferred"}
    others = group(4, "s1", mass=70.0)
    plan = tower((0.0, 4.0), load=210.0)
    simulation = watched(simulation_of(case(plan, [heavy, others])))
    assert simulation.ended == "everybody out"
    assert sorted(simulation.lifts.trips[:, 4].tolist()) in ([1.0, 1.0, 3.0], [1.0, 2.0, 2.0])
    few = {"building.lifts": {"lift 0": {"load": 150.0}}}
    (warning,) = simulation_of(case(plan, [heavy, others], **few)).warnings()
    assert warning.startswith("people.heavy: ")


def test_who_gets_out_and_in_again_does_not_hold_the_doors():
    plan = tower((0.0, 4.0), capacity=4, start="s1", dwell=3.0)
    simulation = simulation_of(case(plan, [group(1, "s1")]))
    lifts, room = simulation.lifts, simulation.building.lifts[0].rooms[1]
    crowd, lobby = simulation.population.crowd, simulation.building.level_named("s1").index
    while crowd.level[0] != room:
        simulation.advance_tick()
    since = simulation.time
    run_ticks(simulation, round(1.0 / simulation.case.simulation.tick))
    inside = crowd.position[0].copy()
    for second in range(8):
        is_out = second % 2 == 0
        with simulation.population.writable():
            crowd.level[0], crowd.position[0] = (lobby, (8.0, 3.0)) if is_out else (room, inside)
            crowd.passing[0] = -1
        run_ticks(simulation, round(1.0 / simulation.case.simulation.tick))
        if lifts.phase[0] != OPEN:
            break
    assert 3.0 <= simulation.time - since <= 5.0


def test_a_run_resumed_while_doors_open_people_board_ride_and_get_out_has_the_same_bits():
    scene = case(tower((0.0, 4.0), cars=2, capacity=3, start="s1"), [group(5, "s1", strategy="quickest")])
    whole, resumed, known = simulation_of(scene), None, set()
    while not whole.ended:
        whole.advance_tick()
        if resumed is not None:
            resumed.advance_tick()
        phases = {*whole.lifts.phase.tolist()}
        if not phases <= known and (RIDES not in phases or len(whole.lifts.trips)):
            known |= phases
            assert_goes_on(whole, resumed)
            resumed = simulation_of(scene)
            resumed.restore(whole.state())
    assert known >= {OPENING, OPEN, CLOSING, RIDES}
    assert_goes_on(whole, resumed)


def test_a_recorded_run_has_its_lifts_and_the_heights_of_people_who_ride(tmp_path):
    scene = case(tower((0.0, 8.0), capacity=5, speed=2.0), [group(5, "s1")], **{"output.every": 0.2})
    results = evac.run(scene, tmp_path / "r", progress=False)
    read = evac.read_results(tmp_path / "r")
    assert read.lifts == results.lifts
    assert read.lifts[0]["people"] == 5
    for one, other in zip(read.crossings, results.crossings, strict=True):
        np.testing.assert_array_equal(one, other)
    trajectory = read.trajectory
    assert trajectory.building.lifts == results.building.lifts
    z = trajectory.z
    inside = ~np.isnan(z)
    assert ((z[inside] >= -1e-9) & (z[inside] <= 8.0 + 1e-9)).all()
    between = (z > 0.5) & (z < 7.5)
    assert (between.sum(axis=0) > 8).all()  # everybody has been on the way
    speed = np.abs(np.diff(z, axis=0)) / 0.2
    assert np.nanmax(speed) <= 2.0 + 0.1

    export_vtk(trajectory, tmp_path)
    reader = pyvista.get_reader(tmp_path / "animation.pvd")
    k = int(np.flatnonzero(between.all(axis=1))[0])
    reader.set_active_time_value(reader.time_values[k])
    people, _, cars = reader.read()
    assert (set(cars["people"]), set(cars["open"])) == ({5}, {0})
    np.testing.assert_allclose(cars.bounds[4:], (z[k].min(), z[k].min() + 2.1))  # they stand on its ground
    assert people.bounds[0] > cars.bounds[0]
    assert people.bounds[1] < cars.bounds[1]

    (car,) = cars_for_page(packed(trajectory), trajectory.changes)
    heights = [trajectory.building.levels[level].z_min + 0.01 * rise for level, rise, _ in car["states"]]
    assert len(heights) == len(trajectory)
    assert heights[k] == pytest.approx(z[k].min(), abs=0.006)
    assert np.abs(np.diff(heights)).max() <= 0.2 * 2.0 + 0.02  # the car does not jump between storeys

    assert {*trajectory.maps(["s1"])} == {"s1", "lift 0 s1"}
    figure = draw_map(trajectory, "density", levels=["s1"])
    assert not [text for text in figure.texts if "opens at" in text.get_text()]

    def has_car(k, view, *levels):
        picture = Renderer(trajectory, (400, 400), view=view, levels=levels or None).image(k)
        return bool((np.abs(picture - np.array(rgb([CAR])[0], float)).max(axis=2) < 40).any())

    last = len(trajectory) - 1  # the car stands at s0
    for view in ("3d", "plan"):
        assert has_car(k, view)
        found = [has_car(frame, view, level) for frame in (k, last) for level in ("s0", "s1")]
        assert found == [False, False, True, False]


@pytest.mark.parametrize(
    ("kind", "value"), [("open", None), ("one_way", False), ("control", {"every": 1.0}), ("lift", ("opens at", "s1"))]
)
def test_events_name_lifts_and_not_their_doors(kind, value):
    event = {"time": 3.0, "kind": kind, "target": "s1 - lift 0 s1"} | ({} if value is None else {"value": value})
    with pytest.raises(EvacError, match="lift 0"):
        simulation_of(case(tower((0.0, 4.0)), [group(3, "s1")], event=[event]))


def test_a_closed_storey_leaves_the_doors_of_lifts_to_the_lift():
    """People in the car get out where nobody may enter, and no more get in than there is room for."""
    event = {"time": 3.0, "kind": "no_entry", "target": "s1"}
    plan = tower((0.0, 4.0), stair=True, capacity=2)
    simulation = watched(simulation_of(case(plan, [group(5, "s1")], event=[event])))
    assert simulation.ended == "everybody out"
