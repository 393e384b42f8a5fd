"""Who takes a lift: shares by group and storey, patience, and lifts that events take out of service."""

import numpy as np

import evac
from evac.directions.routes import PREFERRED
from evac.simulation.shared import simulation_of
from tests.simulation.test_lifts import tower


def towers(number, behaviour, *events, people=None, **changes):
    groups = [{"name": f"from {level}", "number": number, "level": level} for level in ("s1", "s2", "s3")]
    table = {
        "building": tower((0.0, 4.0, 8.0, 12.0), stair=True, cars=2, capacity=8),
        "contact": {"model": "nsm1"},
        "behaviours": {"walking": {}, "lift_use": behaviour},
        "people": groups if people is None else people,
        "event": list(events),
        "directions": {"spacing": 0.2},
        "simulation": {"duration": 900.0},
    }
    return simulation_of(evac.load(table, changes))


def riders(simulation):
    prefers = np.array([route.lifts == PREFERRED for route in simulation.fields.routes])
    return np.flatnonzero(prefers[simulation.population.crowd.route])


def test_a_share_of_200_people_takes_a_lift():
    drawn = [len(riders(towers(200 // 3 + 1, {"share": 0.3}, **{"simulation.seed": seed}))) for seed in range(3)]
    assert all(abs(one - 60.3) <= 13 for one in drawn)
    assert len({*drawn}) > 1


def test_the_share_grows_with_the_storeys_above_the_discharge():
    simulation = towers(100, {"share": 0.0, "share_per_storey": 0.25})
    level = simulation.population.crowd.level[riders(simulation)]
    names = [simulation.building.levels[index].name for index in level.tolist()]
    for storey in (1, 2, 3):
        expected, deviation = 25.0 * storey, np.sqrt(100 * 0.25 * storey * (1.0 - 0.25 * storey))
        assert abs(names.count(f"s{storey}") - expected) <= 3.0 * deviation


def test_who_has_waited_too_long_takes_the_stairs_except_who_cannot():
    people = [
        {"name": "many", "number": 30, "level": "s3"},
        {"name": "wheelchairs", "number": 2, "level": "s3", "steepest": 0.0},
    ]
    simulation = towers(0, {"share": 1.0, "patience": 25.0}, people=people)
    results = simulation.run()
    assert results.ended == "everybody out"
    rode = {int(row) for row in simulation.lifts.rides[:, 0]}
    assert {30, 31} <= rode
    note = next(note for note in results.notes if note.startswith("lift_use"))
    gave_up = 32 - len(rode)
    assert 5 <= gave_up <= 25
    assert f"{gave_up} of 30" in note


def test_a_lift_that_goes_out_of_service_brings_its_people_down_and_the_others_use_what_is_left():
    at = 14.0
    event = {"kind": "close", "target": "lift 0", "time": at}
    simulation = towers(2, {"share": 1.0}, event)
    results = simulation.run()
    assert results.ended == "everybody out"
    first = simulation.lifts.trips[simulation.lifts.trips[:, 0] == 0]
    assert (first[:, 1] <= at + 6.0).all()
    assert simulation.lifts.stop[0] == simulation.building.lifts[0].discharge
    assert len(simulation.lifts.rides) == 6  # the others by the second car
