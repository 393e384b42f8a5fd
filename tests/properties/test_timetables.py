"""Random timetables: random buildings change at random times, people arrive, and a run is killed and resumed.

Nobody passes a closed link or door but those who stood on its line, nor a portal or
door against its direction; nobody is lost, or stands still at the end of a run without progress although a way is open;
everything that is written names the same changes; and a run that was resumed, or that
has all parts (``full``), gives the same bits.
"""

import json
import math
import random
from typing import Any

import numpy as np
import pytest
import shapely

import evac
from evac import Behaviour, Parameter
from evac.base.errors import ScenarioError
from evac.building.model.links import building_at
from evac.contract.registry import Registry
from evac.directions.build import build_fields
from evac.folder.files import SUMMARY_NAME
from tests.properties.seeded import MODELS, drawn
from tests.properties.twice import KINDS, made_again

TICK, EVERY = 0.1, (0.1, 0.3, 0.5)


class Timetable(Behaviour):
    """Opens and closes links at given times."""

    name = "timetable"
    rows = Parameter("[]", "time, kind and name of each change, as JSON")

    def prepare(self, scene: Any) -> None:
        """Apply the changes."""
        for time, kind, what in json.loads(self.rows):
            scene.apply(evac.Change(time, kind, what))


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("kind", ["once", *KINDS])
@drawn(1)
def test_people_pass_open_links_only_and_a_run_made_again_has_the_same_bits(kind, seed, tmp_path_factory):
    tmp_path = tmp_path_factory.mktemp("timetable")
    generator = random.Random(f"{kind}-{seed}")
    registry = Registry()
    registry.add_class(Timetable)
    try:
        loaded = evac.load(table_of(generator), registry=registry)
        one = evac.run(loaded, tmp_path / "one", progress=False)
    except ScenarioError:
        return
    check(one)
    if kind != "once":
        try:
            made_again(kind, loaded, one, tmp_path, generator)
        except ScenarioError:
            assert kind == "full"  # the ways of routes that nobody takes can end at gaps of less than two cells
            return


def check(results: Any) -> None:
    """Check that nobody passed a closed link, and that everything names the same changes."""
    trajectory, crowd = results.trajectory, results.crowd
    again = evac.read_results(results.folder)
    written = json.loads((results.folder / SUMMARY_NAME).read_text(encoding="utf-8"))["changes"]
    assert list(trajectory.changes) == list(results.changes) == list(again.changes)
    assert written == [change.as_row() for change in results.changes]
    start, end = trajectory.building, results.building
    assert trajectory.building_at(results.time).closed == end.closed == again.building.closed
    assert trajectory.building_at(-1.0).closed == start.closed
    for change in results.changes:
        assert abs(change.time / TICK - round(change.time / TICK)) < 1e-6, change
    for person, time in enumerate(crowd.exit_time.tolist()):
        if math.isfinite(time):
            assert_open(results, start.link_of(start.exits[int(crowd.exit_used[person])]), time, person)
    for person, portal, time in zip(*results.crossings, strict=True):
        assert_open(results, int(portal), float(time), int(person))
    check_directions(results)
    check_doors(results)
    check_people(results)
    for frame, after in zip(trajectory.rows, trajectory.rows[1:], strict=False):
        for change in after.changes:
            assert frame.time - 1e-9 <= change.time <= after.time, (frame.time, change)
    for time in trajectory.time.tolist():
        assert trajectory.building_at(time).closed == building_at(start, results.changes, time).closed


def check_directions(results: Any) -> None:
    """Check that nobody passes a portal against its direction, except who is on its line and returns, or was pushed."""
    last: dict[int, tuple[int, float]] = {}
    level = {person: int(first) for person, first in enumerate(results.start_level)}
    to_return: dict[int, tuple[int, float]] = {}  # those whom their speed carried over the line when it got a direction
    for person, portal, time in zip(*(array.tolist() for array in results.crossings), strict=True):
        tick = max(0, math.ceil(time / TICK - 1e-6) - 1)
        origins = dict(results.trajectory.building_at(tick * TICK + 1e-7).one_way)
        before = last.get(person, (-1, -math.inf))
        if (ought := to_return.pop(person, None)) is not None:
            assert ought[0] == portal, f"person {person} passed portal {ought[0]} against its direction at {ought[1]} s"
            assert time - ought[1] < 5.0, f"person {person} returned through portal {portal} at {time} s"
        elif portal in origins and level[person] != origins[portal]:
            if before[0] == portal:
                assert time - before[1] < 5.0, f"person {person} returned through portal {portal} at {time} s"
            else:
                turned = [one.time for one in results.changes if one.kind == "one_way" and one.time <= time]
                assert turned, f"person {person} passed portal {portal} against its direction at {time} s"
                assert time - turned[-1] < 0.5, f"person {person} passed portal {portal} against direction, {time} s"
                to_return[person] = portal, time
        last[person] = portal, time
        level[person] = results.building.portals[portal].other(level[person])
    for person, (portal, time) in to_return.items():
        assert results.time - time < 5.0, f"person {person} passed portal {portal} against its direction at {time} s"


def check_doors(results: Any) -> None:
    """Check that nobody passes a closed door, or one of one direction against it, except who was on its line."""
    trajectory, start = results.trajectory, results.trajectory.building
    let_through = {row for change in results.changes for row in change.values.get("let_through", ())}
    for link, door in enumerate(start.doors, start.n_links):
        (one, two), passed = door.segment.reshape(2, 2), dict[int, float]()
        normal = np.array([two[1] - one[1], one[0] - two[0]])  # to the right of the segment
        for k in range(1, len(trajectory)):
            times = [TICK * round(trajectory.time[j] / TICK) + 1e-7 for j in (k - 1, k)]
            states = [trajectory.building_at(time) for time in (times[0], times[1] - TICK)]
            frames = [
                dict(zip(frame["person"].tolist(), zip(frame["level"], frame["position"], strict=True), strict=True))
                for frame in (trajectory[k - 1], trajectory[k])
            ]
            for person in frames[0].keys() & frames[1].keys():
                (level, here), (after, there) = (frame[person] for frame in frames)
                sides = [float((place - one) @ normal) for place in (here, there)]
                if level != door.level or after != door.level or sides[0] * sides[1] >= 0.0:
                    continue
                share = sides[0] / (sides[0] - sides[1])
                if not 0.0 < float((here + share * (there - here) - one) @ (two - one)) < door.width**2:
                    continue
                from_, before = int(sides[0] > 0.0), passed.get(person, -math.inf)
                if person not in let_through and times[1] - before > 5.0:
                    assert any(link not in state.closed for state in states), f"person {person} passed closed {link}"
                    assert any(state.directed.get(link, from_) == from_ for state in states), (
                        f"person {person} passed the door {link} against its direction at {times[1]} s"
                    )
                passed[person] = times[1]


def check_people(results: Any) -> None:
    """Check that the run ends for a reason, that nobody is lost, and that nobody stands still with an open way."""
    crowd, building = results.crowd, results.building
    assert results.ended in {"everybody out", "duration over", "no progress"}
    has_come, is_out = ~np.isnan(crowd.arrival_time), np.isfinite(crowd.exit_time)
    inside = np.flatnonzero(crowd.level >= 0)
    assert ((crowd.level >= 0) == (has_come & ~is_out)).all()
    for row in inside.tolist():
        ground = building.levels[crowd.level[row]].polygon
        assert shapely.dwithin(ground, shapely.Point(crowd.position[row]), 1e-6), f"person {row} is outside its level"
    if results.ended == "no progress":
        fields = build_fields(building, tuple(results.routes), anywhere=True)
        time = fields.travel_time_at(crowd.level[inside], crowd.position[inside], crowd.route[inside])
        free = inside[np.isfinite(time) & (crowd.start_time[inside] <= results.time)]
        assert not len(free), f"people {free.tolist()} stand still with an open way"


def assert_open(results: Any, link: int, time: float, person: int) -> None:
    """Check that a link was open in the tick that contains or ends at a time, or has let a person through."""
    trajectory, tick = results.trajectory, max(0, math.ceil(time / TICK - 1e-6) - 1)
    closed = trajectory.building_at(tick * TICK + 1e-7).closed
    let_through = {row for change in results.changes for row in change.values.get("let_through", ())}
    assert link not in closed or person in let_through, f"person {person} passed the closed link {link} at {time} s"


def table_of(generator: random.Random) -> dict[str, Any]:
    """Return a case: two storeys with a stair, doors and up to three exits, people of a model, and a timetable."""
    wide, deep, slot = generator.uniform(7.0, 10.0), generator.uniform(5.0, 8.0), generator.uniform(0.8, 1.6)
    exits = [
        {"name": "main", "storey": "ground", "segment": [[0, 3.0], [0, 3.0 + slot]]},
        {"name": "back", "storey": "ground", "segment": [[wide, 1.0], [wide, 1.0 + slot]]},
        {"name": "side", "storey": "first", "segment": [[wide, 2.0], [wide, 2.0 + slot]]},
    ]
    floor = [[0, 0], [wide, 0], [wide, deep], [0, deep]]
    rooms = {
        "near": [[0, 0], [wide, 0], [wide, 2.6], [0, 2.6]],
        "far": [[0, 2.8], [wide, 2.8], [wide, deep], [0, deep]],
    }
    doors = [
        {"name": "inner", "storey": "ground", "segment": [[2.0, 2.7], [2.0 + 0.8 * slot, 2.7]]},
        {"name": "spare", "storey": "ground", "segment": [[5.0, 2.7], [5.9, 2.7]]},
    ]
    doors = doors[: generator.randrange(3)]
    ground = {"name": "ground", "polygons": [*rooms.values()] if doors else [floor]}
    plan = {
        "storeys": [ground, {"name": "first", "z": 2.0, "polygons": [floor]}],
        "doors": doors,
        "areas": [{"name": name, "storey": "ground", "polygon": polygon} for name, polygon in rooms.items()],
        "stairs": [
            {
                **{"name": "stair", "lower": "ground", "lower_edge": [[1, 0.8], [1, 2]], "upper": "first"},
                **{"length": generator.uniform(3.5, 5.0), "direction": [1, 0]},
            }
        ],
        "exits": generator.sample(exits, generator.randrange(1, 4)),
    }
    names = [one["name"] for one in (*plan["exits"], *doors)] + ["stair"]
    exits = [one["name"] for one in plan["exits"]]
    rows = [
        [time_of(generator), generator.choice(["open", "close", "close"]), generator.choice(names)]
        for _ in range(generator.randrange(1, 9))
    ]
    if generator.random() < 0.2:
        rows += [[generator.choice([0.0, 1.0, 1.05]), "close", name] for name in names]
    changes = [one for _ in range(generator.randrange(6)) for one in event_of(generator, names, exits)]
    behaviours: dict[str, Any] = {"timetable": {"rows": json.dumps(rows)}}
    behaviours |= generator.choice([{"walking": {}}, {"headway": {}}, {}])
    behaviours |= {"route_choice": {"every": 0.5}} if generator.random() < 0.4 else {}
    crowd = {"radius": generator.choice([0.2, 0.25]), "speed": generator.choice([0.8, 1.4, 2.0])}
    crowd["strategy"] = generator.choice(["fastest", "shortest", "quickest", "quickest"])
    people = [
        {"name": level, "number": generator.randrange(1, 13), "level": level, **crowd} for level in ("ground", "first")
    ]
    if generator.random() < 0.5:
        people.append(group_that_comes(generator, exits) | crowd)
    return {
        "event": changes,
        "building": {"plan": plan, "closed": generator.sample(names, generator.choice([0, 0, 1]))},
        "people": people,
        "contact": {"model": generator.choice(MODELS)},
        "directions": {"spacing": generator.choice([0.1, 0.2, 0.25, 0.25])},
        "behaviours": behaviours,
        "simulation": {
            "duration": generator.choice([4.03, 6.0, 30.0]),
            "no_progress": 10.0,
            "tick": TICK,
            "seed": generator.randrange(99),
        },
        "output": {"picture": False, "animation": False, "every": generator.choice(EVERY)},
    }


def event_of(generator: random.Random, names: list[str], exits: list[str]) -> list[dict[str, Any]]:
    """Return an event, and sometimes another one that follows it."""
    kind = generator.choice(["open", "close", "one_way", "one_way", "slow", "bar", "strategy"])
    level, group = generator.choice(["ground", "first", "near", "far"]), generator.choice(["ground", "first"])
    link = generator.choice(names)
    ways = ["up", "down"] if link == "stair" else ["in", "out"] if link in exits else ["near", "far"]
    target, value = {
        "one_way": (link, generator.choice([*ways, False])),
        "slow": (level, generator.choice([0.2, 0.7, 1.0])),
        "bar": (level, generator.choice([True, False])),
        "strategy": (group, generator.choice(["shortest", "comfortable", [], [generator.choice(exits)]])),
    }.get(kind, (link, None))
    name = f"event {generator.randrange(10**9)}"
    when: dict[str, Any] = generator.choice(
        [{"out": 3}, {"area": level, "count": 5}, {"area": level, "at_most": 4}, {"area": level, "density": 0.2}]
    )
    one: dict[str, Any] = {"name": name, "kind": kind, "target": target}
    one |= {"time": abs(time_of(generator)) % 50.0} if generator.random() < 0.6 else {"when": when}
    one |= {} if value is None else {"value": value}
    after = {"when": {"event": name, "after": generator.choice([0.0, 0.05, 2.0])}, "kind": "open", "target": "stair"}
    return [one, after] if generator.random() < 0.2 else [one]


def group_that_comes(generator: random.Random, exits: list[str]) -> dict[str, Any]:
    """Return a group of people who come during the run."""
    times = {"times": [generator.uniform(0.0, 20.0) for _ in range(generator.randrange(1, 12))]}
    rate = {"rate": generator.uniform(0.2, 2.0), "from": 0.0, "to": generator.uniform(1.0, 15.0)}
    arrive = generator.choice([times, rate])
    if generator.random() < 0.4:
        return {"name": "late", "arrive": arrive | {"exit": generator.choice(exits)}}
    arrive |= {"portal": "stair"} if generator.random() < 0.5 else {}
    return {"name": "late", "arrive": arrive, "level": generator.choice(["ground", "first"])}


def time_of(generator: random.Random) -> float:
    """Return a time before, at or after the start, at or between ticks, and at times after the end [s]."""
    kinds = [
        generator.uniform(-1.0, 7.0),
        TICK * generator.randrange(40),
        TICK * (generator.randrange(40) + 0.5),
        math.nextafter(TICK * generator.randrange(1, 40), generator.choice([0.0, 9.0])),
        generator.choice([-1e300, 1e300, 0.0, -0.0, 5e-324]),
    ]
    return generator.choice(kinds)
