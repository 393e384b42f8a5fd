"""Attacks by timetables: random buildings change at random times, people arrive, and a run is killed and resumed.

`run` raises AssertionError unless nobody passes a closed link but those who stood on its line, nor a portal against its
direction; nobody is lost, or stands still at the end of a run without progress although a way is open; everything that
is written names the same changes; and a run that was resumed, in its folder or in another one (``branched``), or that
has all parts (``full``) or two threads (``threads``) gives the same bits.
"""

import json
import math
import random
from pathlib import Path
from typing import Any

import numpy as np
import shapely

import evac
from evac import Behaviour, Parameter
from evac.base.errors import ScenarioError
from evac.building.model.links import building_at
from evac.contract.registry import Registry
from evac.directions.build import build_fields
from evac.folder.files import SUMMARY_NAME
from tests.attacks.commands import MODELS
from tests.attacks.seeded import in_turn
from tests.attacks.twice import KINDS, made_again

TICK, EVERY = 0.1, (0.1, 0.3, 0.5)

cases = in_turn(KINDS)


class Timetable(Behaviour):
    """Opens and closes links at given times."""

    name = "timetable"
    rows = Parameter("[]", "time, kind and name of each change, as JSON")

    def prepare(self, scene: Any) -> None:
        """Apply the changes."""
        for time, kind, what in json.loads(self.rows):
            scene.apply(evac.Change(time, kind, what))


def run(case: Any, folder: Path) -> str:
    """Run a case twice; return how it ended."""
    generator = random.Random(f"{case}")
    registry = Registry()
    registry.add_class(Timetable)
    try:
        loaded = evac.load(table_of(generator), registry=registry)
        one = evac.run(loaded, folder / "one", progress=False)
    except ScenarioError:
        return "refused"
    check(one)
    two = made_again(case.kind, loaded, one, folder, generator)
    if case.kind == "branched":
        check(two)
    return one.ended


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
    check_people(results)
    for frame, after in zip(trajectory.rows, trajectory.rows[1:], strict=False):
        for change in after.changes:
            assert frame.time - 1e-9 <= change.time <= after.time, (frame.time, change)
    for time in trajectory.time.tolist():
        assert trajectory.building_at(time).closed == building_at(start, results.changes, time).closed


def check_directions(results: Any) -> None:
    """Check that nobody passes a portal against its direction, except who was pushed back on its line."""
    last: dict[int, tuple[int, float]] = {}
    level = {person: int(first) for person, first in enumerate(results.start_level)}
    for person, portal, time in zip(*(array.tolist() for array in results.crossings), strict=True):
        tick = max(0, math.ceil(time / TICK - 1e-6) - 1)
        origins = dict(results.trajectory.building_at(tick * TICK + 1e-7).one_way)
        before = last.get(person, (-1, -math.inf))
        if portal in origins and level[person] != origins[portal]:
            assert before[0] == portal, f"person {person} passed portal {portal} against its direction at {time} s"
            assert time - before[1] < 5.0, f"person {person} returned through portal {portal} at {time} s"
        last[person] = portal, time
        level[person] = results.building.portals[portal].other(level[person])


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
        fields = build_fields(building, tuple(results.routes))
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
    """Return a case: two storeys with a stair and up to three exits, people of a model, and a timetable."""
    wide, deep, slot = generator.uniform(7.0, 10.0), generator.uniform(5.0, 8.0), generator.uniform(0.8, 1.6)
    exits = [
        {"name": "main", "storey": "ground", "segment": [[0, 3.0], [0, 3.0 + slot]]},
        {"name": "back", "storey": "ground", "segment": [[wide, 1.0], [wide, 1.0 + slot]]},
        {"name": "side", "storey": "first", "segment": [[wide, 2.0], [wide, 2.0 + slot]]},
    ]
    floor = [[0, 0], [wide, 0], [wide, deep], [0, deep]]
    plan = {
        "storeys": [{"name": "ground", "polygons": [floor]}, {"name": "first", "z": 2.0, "polygons": [floor]}],
        "stairs": [
            {
                **{"name": "stair", "lower": "ground", "lower_edge": [[1, 0.8], [1, 2]], "upper": "first"},
                **{"length": generator.uniform(3.5, 5.0), "direction": [1, 0]},
            }
        ],
        "exits": generator.sample(exits, generator.randrange(1, 4)),
    }
    names = [one["name"] for one in plan["exits"]] + ["stair"]
    rows = [
        [time_of(generator), generator.choice(["open", "close", "close"]), generator.choice(names)]
        for _ in range(generator.randrange(1, 9))
    ]
    if generator.random() < 0.2:
        rows += [[generator.choice([0.0, 1.0, 1.05]), "close", name] for name in names]
    changes = [one for _ in range(generator.randrange(6)) for one in event_of(generator, names, len(names) - 1)]
    behaviours: dict[str, Any] = {"timetable": {"rows": json.dumps(rows)}}
    behaviours |= generator.choice([{"walking": {}}, {"headway": {}}, {}])
    behaviours |= {"route_choice": {"every": 0.5}} if generator.random() < 0.4 else {}
    crowd = {"radius": generator.choice([0.2, 0.25]), "speed": generator.choice([0.8, 1.4, 2.0])}
    crowd["strategy"] = generator.choice(["fastest", "shortest", "quickest", "quickest"])
    people = [
        {"name": level, "number": generator.randrange(1, 25), "level": level, **crowd} for level in ("ground", "first")
    ]
    if generator.random() < 0.5:
        people.append(group_that_comes(generator, names[:-1]) | crowd)
    return {
        "event": changes,
        "building": {"plan": plan, "closed": generator.sample(names, generator.choice([0, 0, 1]))},
        "people": people,
        "contact": {"model": generator.choice(MODELS)},
        "behaviours": behaviours,
        "simulation": {
            "duration": generator.choice([3.0, 4.03, 6.0, 4.03, 6.0, 60.0]),
            "no_progress": 10.0,
            "tick": TICK,
            "seed": generator.randrange(99),
        },
        "output": {"picture": False, "animation": False, "every": generator.choice(EVERY)},
    }


def event_of(generator: random.Random, names: list[str], exits: int) -> list[dict[str, Any]]:
    """Return an event, and sometimes another one that follows it."""
    kind = generator.choice(["open", "close", "one_way", "slow", "bar", "strategy"])
    level, group = generator.choice(["ground", "first"]), generator.choice(["ground", "first"])
    target, value = {
        "one_way": ("stair", generator.choice(["up", "down", False])),
        "slow": (level, generator.choice([0.2, 0.7, 1.0])),
        "bar": (level, generator.choice([True, False])),
        "strategy": (group, generator.choice(["shortest", "comfortable", [], [names[generator.randrange(exits)]]])),
    }.get(kind, (generator.choice(names), None))
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
