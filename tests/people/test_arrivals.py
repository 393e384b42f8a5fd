"""People who come during a run, and people who do not leave: nobody is put upon others, results count them apart."""

import numpy as np
import pytest

import evac
from evac.base.errors import ScenarioError
from evac.simulation.shared import simulation_of

FLOOR = [[0, 0], [14, 0], [14, 8], [0, 8]]
TRAIN = {"name": "train", "arrive": {"times": [3.0] * 12 + [20.0]}, "area": "lift", "exits": ["main"]}
GATE = {
    "name": "gate",
    "arrive": {"rate": 1.0, "from": 2.0, "to": 15.0, "exit": "gate"},
    "exits": ["main"],
    "radius": {"uniform": [0.2, 0.3]},
}
STAFF = {"name": "staff", "number": 2, "area": "desk", "leave": False}


def hall(*groups, **changes):
    """Return a hall with a main exit, a gate, a lift and a desk, and ten people in it."""
    plan = {
        "storeys": [{"name": "f", "polygons": [FLOOR]}],
        "exits": [
            {"name": "main", "storey": "f", "segment": [[0, 3], [0, 4.2]]},
            {"name": "gate", "storey": "f", "segment": [[14, 3], [14, 4.2]]},
        ],
        "areas": [
            {"name": "lift", "storey": "f", "polygon": [[12, 6], [13.8, 6], [13.8, 7.8], [12, 7.8]]},
            {"name": "desk", "storey": "f", "polygon": [[6, 6], [8, 6], [8, 7.5], [6, 7.5]]},
        ],
    }
    table = {
        "building": {"plan": plan},
        "contact": {"model": "nsm1"},
        "simulation": {"duration": 90.0, "no_progress": 10.0},
        "people": [{"name": "a", "number": 10, "level": "f", "exits": ["main"]}, *groups],
    }
    return evac.load(table, changes)


def rows_of(run, name):
    return next(group.rows for group in run.groups if group.name == name)


def test_people_come_at_their_times_and_leave_and_who_stays_is_counted_apart():
    results = simulation_of(hall(TRAIN, GATE, STAFF)).run()
    came = results.crowd.arrival_time
    assert results.ended == "everybody out"
    assert (results.staying, results.not_arrived, results.exit_status) == (2, 0, 0)
    assert results.evacuated == results.number_of_people - 2
    assert (came[rows_of(results, "a")] == 0.0).all()
    train = came[rows_of(results, "train")]
    assert (train[:12] >= 3.0 - 1e-9).all()
    assert train[12] == pytest.approx(20.0)
    assert results.exits["gate"]["people"] == 0
    assert results.crowd.level[rows_of(results, "staff")].tolist() == [0, 0]
    assert results.summary()["staying"] == 2
    assert any("did not leave" in line for line in results.remarks)


def test_a_rate_is_a_poisson_process_of_the_group_alone():
    numbers = []
    for seed in range(20):
        simulation = simulation_of(hall(GATE, **{"simulation.seed": seed, "directions.spacing": 0.5}), will_run=False)
        (source,) = simulation.population.sources
        assert ((source.due >= 2.0) & (source.due < 15.0)).all()
        numbers.append(len(source.due))
    assert np.mean(numbers) == pytest.approx(13.0, abs=3.0 * np.sqrt(13.0 / 20))
    assert np.var(numbers) == pytest.approx(13.0, rel=0.7)
    both = simulation_of(hall(GATE, TRAIN), will_run=False).population.sources
    alone = simulation_of(hall(GATE), will_run=False).population.sources
    assert both[0].due.tolist() == alone[0].due.tolist()


def test_at_a_low_rate_nobody_may_come():
    rare = {**GATE, "arrive": {"rate": 1e-6, "from": 0.0, "to": 1.0, "exit": "gate"}}
    results = simulation_of(hall(rare)).run()
    assert (results.ended, results.number_of_people) == ("everybody out", 10)


def test_a_run_to_which_nobody_comes_is_refused():
    table = hall({"name": "rare", "area": "lift", "arrive": {"rate": 1e-6, "from": 0.0, "to": 1.0}}).to_dict()
    table["people"] = [group for group in table["people"] if group["name"] == "rare"]
    with pytest.raises(ScenarioError, match=r"people: nobody comes with seed 1"):
        simulation_of(evac.load(table), will_run=False)


@pytest.mark.parametrize("model", ["nsm1", "dem"])
def test_nobody_is_put_upon_others_and_who_finds_no_place_waits_outside(model):
    crowd = {**TRAIN, "arrive": {"times": [1.0] * 60}, "radius": 0.25, "speed": 0.3}
    simulation = simulation_of(hall(crowd, **{"contact.model": model, "simulation.duration": 6.0}))
    people = simulation.population.crowd
    while not simulation.ended:
        before = np.isnan(people.arrival_time)
        simulation.let_in()
        new = np.flatnonzero(before & ~np.isnan(people.arrival_time))
        inside = np.flatnonzero(people.level >= 0)
        for row in new.tolist():
            away = np.hypot(*(people.position[inside] - people.position[row]).T)
            assert (away[inside != row] >= (people.radius[inside] + people.radius[row])[inside != row]).all()
        simulation.advance_tick()
    results = simulation.results()
    assert results.ended == "duration over"
    assert results.not_arrived == results.waiting_outside > 10
    assert results.exit_status == 3
    assert any(f"{results.waiting_outside} of them found no free place" in line for line in results.remarks)


def test_a_closed_gate_lets_nobody_in_until_it_opens():
    events = [{"kind": kind, "target": "gate", "time": time} for time, kind in ((0.0, "close"), (18.0, "open"))]
    results = simulation_of(hall(GATE, event=events)).run()
    assert results.ended == "everybody out"
    assert (results.crowd.arrival_time[rows_of(results, "gate")] >= 18.0 - 1e-9).all()


def storeys(*groups, **changes):
    """Return two storeys with a stair, whose foot is at x = 1, and an exit on the ground."""
    stair = {"name": "stair", "lower": "ground", "lower_edge": [[1, 0.8], [1, 2]], "upper": "first", "length": 4.0}
    plan = {
        "storeys": [{"name": "ground", "polygons": [FLOOR]}, {"name": "first", "z": 2.0, "polygons": [FLOOR]}],
        "stairs": [stair | {"direction": [1, 0]}],
        "exits": [{"name": "main", "storey": "ground", "segment": [[0, 5], [0, 6.2]]}],
    }
    table = {"building": {"plan": plan}, "contact": {"model": "nsm1"}, "people": list(groups)}
    return evac.load(table, changes)


LIFT = {"name": "lift", "level": "ground", "arrive": {"times": [1.0] * 8, "portal": "stair"}, "radius": 0.2}


def test_people_come_through_a_portal_or_a_stair_onto_a_level_one_row_after_the_other():
    simulation = simulation_of(storeys(LIFT))
    crowd, places = simulation.population.crowd, {}
    while not simulation.ended:
        before = np.isnan(crowd.arrival_time)
        simulation.let_in()
        for row in np.flatnonzero(before & ~np.isnan(crowd.arrival_time)).tolist():
            places[row] = *crowd.position[row].tolist(), simulation.building.levels[crowd.level[row]].name
        simulation.advance_tick()
    assert simulation.ended == "everybody out"
    x, y, level = zip(*places.values(), strict=True)
    assert set(level) == {"ground"}
    assert x == pytest.approx([0.79] * 8)
    assert 0.8 <= min(y) < max(y) <= 2.0
    assert len(np.unique(crowd.arrival_time)) > 2
    closed = simulation_of(storeys(LIFT, **{"building.closed": ["stair"], "simulation.duration": 5.0})).run()
    assert (closed.not_arrived, closed.waiting_outside) == (8, 8)


def test_response_times_of_people_who_arrive_count_from_their_arrival():
    response = {"behaviours.response_time.time": 4.0}
    early = {"name": "early", "number": 2, "level": "ground"}
    lift = LIFT | {"arrive": {"times": [3.0, 9.0], "portal": "stair"}}
    for own, wait in (({}, 0.0), ({"time": 5.0}, 5.0), ({"begin": "start"}, 4.0)):  # who comes through a door walks on
        results = simulation_of(storeys(lift | {"behaviours": {"response_time": own}}, early, **response)).run()
        start, rows = results.crowd.start_time, rows_of(results, "lift")
        assert start[rows_of(results, "early")].tolist() == [4.0, 4.0]
        assert start[rows] == pytest.approx([3.0 + wait, 9.0 + wait])
        assert (results.crowd.exit_time[rows] > start[rows]).all()


def test_pictures_and_studies_count_those_who_have_come_and_leave(tmp_path):
    gate = {**GATE, "arrive": GATE["arrive"] | {"to": 5.0}}
    results = simulation_of(
        hall(TRAIN | {"arrive": {"times": [1.0, 200.0]}}, STAFF, **{"simulation.duration": 30.0})
    ).run()
    title = results.plot().axes[0].get_title(loc="left")
    assert "11 of 11 out" in title
    assert "2 stay; 1 have not come" in title
    study = evac.repeat(hall(gate, STAFF), 4, folder=tmp_path / "study")
    people = [row["people"] for row in study.rows(0, ["people"])]
    assert len(set(people)) > 1
    assert [row["out"] for row in study.rows(0, ["out"])] == people


@pytest.mark.parametrize(
    ("group", "words"),
    [
        ({**TRAIN, "number": 3}, r"people\.train\.number"),
        ({**TRAIN, "area": None, "level": None}, r"people\.train\.arrive"),
        ({**TRAIN, "arrive": {"times": [1.0], "rate": 1.0}}, r"arrive\.times"),
        ({**TRAIN, "arrive": {"rate": 1.0, "from": 3.0, "to": 2.0}}, r"arrive\.to"),
        ({**GATE, "arrive": {"times": [1.0], "exit": "gat"}}, r"arrive\.exit.*'gat'.*'gate'"),
        ({**GATE, "arrive": {"times": [1.0], "exit": "gate", "portal": "stair"}}, r"people\.gate\.level"),
        ({**GATE, "level": "f", "arrive": {"times": [1.0], "portal": "stair"}}, r"arrive\.portal.*'stair'.*'f'"),
    ],
)
def test_arrivals_that_cannot_be_are_refused_with_their_key(group, words):
    with pytest.raises(ScenarioError, match=words):
        simulation_of(hall({key: value for key, value in group.items() if value is not None}), will_run=False)
