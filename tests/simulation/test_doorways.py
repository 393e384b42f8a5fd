"""People on the line of a link that closes are named and let through; nobody else passes it, and nobody overlaps."""

import numpy as np
import pytest
from shapely import box

import evac
from evac.simulation.simulation import Simulation
from tests.runs import run_ticks

CLOSES = 4.0


def hall(model, seed=0):
    """Return a hall of 60 people with an exit at either end."""
    exits = [
        {"name": "west", "storey": "f", "segment": [[0, 4], [0, 5.2]]},
        {"name": "east", "storey": "f", "segment": [[12, 4], [12, 5.2]]},
    ]
    storey = {"name": "f", "polygons": [[[0, 0], [12, 0], [12, 9], [0, 9]]]}
    return evac.load(
        {
            "building": {"plan": {"storeys": [storey], "exits": exits}},
            "contact": {"model": model},
            "simulation": {"duration": 60.0, "seed": seed},
            "people": [{"name": "p", "number": 60, "level": "f"}],
        }
    )


def distance_to(segment, position):
    start, end = np.array(segment).reshape(2, 2)
    share = np.clip((position - start) @ (end - start) / np.sum((end - start) ** 2), 0.0, 1.0)
    return np.linalg.norm(position - start - share[:, None] * (end - start), axis=1)


@pytest.mark.parametrize(("model", "overlap"), [("nsm1", 1e-4), ("nsm2", 0.03), ("dem", 0.08)])
def test_who_stands_in_a_closing_doorway_is_named_and_leaves_by_it_and_nobody_else_does(model, overlap):
    """In seed 0 of nsm2 the crowd pushes one of them back before."""
    simulation = Simulation(hall(model, seed=2 if model == "dem" else 0))
    simulation.scene.apply(evac.Change(CLOSES, "close", "west"))
    run_ticks(simulation, round(CLOSES / 0.1))
    crowd = simulation.population.crowd
    way = next(way for way in simulation.building.exits if way.name == "west")
    away = distance_to(way.segments[0], crowd.position)
    on_line = np.flatnonzero((crowd.level >= 0) & (away < crowd.contact_radius)).tolist()
    results = simulation.run()
    (change,) = results.changes
    assert len(on_line) == 2
    assert list(change.values["let_through"]) == on_line
    assert results.summary()["changes"][0]["values"] == {"let_through": on_line}
    numbers = f"numbers {on_line[0]}, {on_line[1]}"
    assert any("'west'" in warning and numbers in warning for warning in results.warnings)
    later = (results.crowd.exit_used == way.index) & (results.crowd.exit_time > CLOSES)
    assert np.flatnonzero(later).tolist() == on_line
    assert results.ended == "everybody out"
    assert results.report["greatest_overlap"] < overlap
    assert (results.crowd.passing == -1).all()


@pytest.fixture
def stairs():
    """Return a case of two storeys with a stair, and people who go down."""
    floor = [[0, 0], [10, 0], [10, 6], [0, 6]]
    stair = {"name": "stair", "lower": "ground", "lower_edge": [[1, 0.8], [1, 2]], "upper": "first", "length": 4.0}
    plan = {
        "storeys": [{"name": "ground", "polygons": [floor]}, {"name": "first", "z": 2.0, "polygons": [floor]}],
        "stairs": [stair | {"direction": [1, 0]}],
        "exits": [
            {"name": "main", "storey": "ground", "segment": [[0, 3], [0, 4.2]]},
            {"name": "balcony", "storey": "first", "segment": [[10, 3], [10, 4.2]]},
        ],
    }
    return evac.load(
        {
            "building": {"plan": plan},
            "contact": {"model": "nsm1"},
            "simulation": {"duration": 60.0},
            "people": [{"name": "people", "number": 30, "level": "first", "exits": ["main"]}],
        }
    )


def test_who_stands_between_a_storey_and_a_closing_stair_goes_on_and_nobody_else_does(stairs):
    simulation = Simulation(stairs)
    closes = 6.0
    simulation.scene.apply(evac.Change(closes, "close", "stair", {"value": "all"}))
    results = simulation.run()
    let_through = results.changes[0].values["let_through"]
    person, portal, time = results.crossings
    assert len(let_through) > 1
    assert set(person[time > closes].tolist()) <= set(let_through)
    last = {int(one): int(link) for one, link in zip(person, portal, strict=True)}
    on_stair = [row for row in range(30) if results.building.levels[results.crowd.level[row]].kind == "flight"]
    assert all(row in last for row in on_stair), "who is shut in on the stair has entered it"
    above = [row for row in range(30) if row not in last]
    balcony = next(way.index for way in simulation.building.exits if way.name == "balcony")
    assert len(above) > 5
    assert (results.crowd.exit_used[above] == balcony).all(), "the only exit that they can still reach"


def test_an_exit_that_opens_again_holds_nobody():
    simulation = Simulation(hall("nsm1"))
    simulation.scene.apply(evac.Change(CLOSES, "close", "west"))
    simulation.scene.apply(evac.Change(CLOSES + 0.1, "open", "west"))
    run_ticks(simulation, round(CLOSES / 0.1) + 1)
    crowd = simulation.population.crowd
    assert (crowd.passing >= 0).any()
    run_ticks(simulation, 1)
    assert (crowd.passing == -1).all()
    assert not crowd.ahead.any()
    assert simulation.scene.world.link_open.tolist() == [1, 1]


def test_the_last_one_who_leaves_a_closing_shaft_is_not_turned_back_into_it():
    """Beyond the line, the way that was shorter led back to it."""
    plan = evac.Plan()
    for number, name in enumerate("gfs"):
        plan.storey(name, [box(0, 7, 40, 10), box(0, 0, 8, 6.8), box(32, 0, 40, 6.8)], z=3.2 * number)
        plan.door(f"west {name}", name, [(6.4, 6.9), (7.8, 6.9)])
        plan.door(f"east {name}", name, [(32.2, 6.9), (33.6, 6.9)])
    for number, (lower, upper) in enumerate([("g", "f"), ("f", "s")]):
        plan.stair(f"w {number}", lower, [(1, 1), (1, 2.4)], upper, length=5.5, direction=(1, 0))
        plan.stair(f"e {number}", lower, [(39, 1), (39, 2.4)], upper, length=5.5, direction=(-1, 0))
    plan.exit("out", "g", [(0, 8), (0, 9.2)])
    case = {
        "building": plan,
        "contact": {"model": "nsm1"},
        "simulation": {"duration": 200.0},
        "people": [{"name": "p", "positions": [[37.5, 1.91]], "level": "e 1 flight z=3.20..6.40", "speed": 1.2}],
        "event": [{"time": 0.0, "kind": "close", "target": "e"}],
    }
    results = evac.run(case)
    assert [change.values["value"] for change in results.changes] == ["leave", "all"]
    assert results.ended == "everybody out"
