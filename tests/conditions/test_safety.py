"""Times of compartments and margins of people, against code that uses recorded positions."""

import json

import numpy as np
import pytest
import shapely

import evac
from evac.base.errors import ScenarioError
from evac.cli.check import show_available
from evac.results.verdict import verdict_of
from evac.simulation.simulation import Simulation
from tests.conditions.corridor import corridor, prescribed, two_storeys

#: Levels of the plan `two_storeys` with the names of their parts.
FLOORS = {"down": 0.0, "up": 3.0}


def random_case(seed):
    """Return a case with two storeys, smoke and gas in areas, and compartments with criteria."""
    draw = np.random.default_rng(seed)
    plan, compartments, air = two_storeys(), [], []
    plan["areas"] = []
    for name, storey in (("a", "down"), ("b", "up")):
        x, y = 0.5 * draw.integers(0, 12), 0.5 * draw.integers(6, 11)
        width, depth = 0.5 * draw.integers(4, 12), 0.5 * draw.integers(2, 5)
        corners = [[x, y], [x + width, y], [x + width, y + depth], [x, y + depth]]
        plan["areas"].append({"name": name, "storey": storey, "polygon": corners})
    for place in ({"area": "a"}, {"area": "b"}, {"level": "stair"}):
        times = [0.0, *np.cumsum(2.0 * draw.integers(1, 8, 3)).tolist()]
        values = {"extinction": draw.uniform(0.0, 1.0, 4).tolist(), "co": draw.uniform(0.0, 60000.0, 4).tolist()}
        air.append({"source": "prescribed", **place, "times": times, "values": values, "hold": True})
    for name, of in (("one", ["down"]), ("two", ["up", "stair"]), ("three", ["a"]), ("four", ["stair"])):
        limits = {"visibility": float(draw.uniform(3.5, 8.0)), "fed": float(draw.uniform(0.1, 1.0))}
        limits |= {"share": float(draw.choice([0.0, 0.13])), "everybody": bool(draw.integers(2))}
        compartments.append({"name": name, "of": of, "without": ["b"] if draw.integers(2) else [], **limits})
    people = [{"name": n, "level": n, "number": int(draw.integers(1, 7)), "radius": 0.2} for n in FLOORS]
    table = {
        "building": {"plan": plan},
        "contact": {"model": "nsm1"},
        "people": people,
        "conditions": air,
        "smoke": {"law": "none", "routes": False},
        "dose": {"heat": "none", "without": ["co2", "o2"], "threshold": 100.0},
        "behaviours": {"response_time": {"time": {"uniform": [0.0, 12.0]}}},
        "simulation": {"duration": 80.0, "seed": seed},
        "output": {"every": 0.1, "replay": False, "picture": False},
        "safety": {"factor": float(draw.choice([1.0, 1.5]))},
        "compartment": compartments,
    }
    return table


class Recount:
    """The same numbers from the tables of a case and recorded positions: points, times and doses one by one."""

    def __init__(self, table, results):
        self.table, self.run = table, results.trajectory
        self.building, self.case = results.building, results.case
        self.time, self.end = np.arange(0.0, 80.0 * table["safety"]["factor"] + 1e-9, 0.02), 80.0
        self.areas = {one["name"]: one for one in table["building"]["plan"]["areas"]}

    def series(self, name, level, x, y):
        """Return a quantity at a place at all times; the last table that applies."""
        found = np.zeros(len(self.time))
        for one in self.table["conditions"]:
            if ("area" in one and self.inside(one["area"], level, x, y)) or (self.stair(level) and "level" in one):
                found = np.interp(self.time, one["times"], one["values"][name])
        return found

    def stair(self, level):
        return self.building.levels[level].stair == "stair"

    def inside(self, name, level, x, y):
        (x1, y1), _, (x2, y2), _ = self.areas[name]["polygon"]
        return self.building.levels[level].name == self.areas[name]["storey"] and x1 <= x < x2 and y1 <= y < y2

    def belongs(self, one, level, x, y, criteria=False):
        """Return whether a place is in a compartment, and has its criteria."""
        if criteria and any(self.inside(name, level, x, y) for name in one["without"]):
            return False
        names = {self.building.levels[level].name, self.building.levels[level].stair}
        return any(of in names or (of in self.areas and self.inside(of, level, x, y)) for of in one["of"])

    def met(self, one, level, x, y, dose=0.0, now=0.0):
        """Return when a criterion is met at a place, with a dose at a time."""
        smoke = self.series("extinction", level, x, y) > 3.0 / one["visibility"]
        co = self.series("co", level, x, y)
        gained = np.cumsum(3.317e-5 * co**1.036 * (25.0 / 30.0) / 60.0 * 0.02)
        total = dose + gained - np.interp(now, self.time, gained)
        total[self.time < now] = 0.0
        times = [self.time[np.argmax(is_met)] for is_met in (smoke, total >= one["fed"]) if is_met.any()]
        return min(times, default=np.inf)

    def available(self, one):
        points, step = [], 0.25
        for level in self.building.levels:
            x1, y1, x2, y2 = level.polygon.bounds
            for x in np.arange(x1, x2, step) + 0.5 * step:
                for y in np.arange(y1, y2, step) + 0.5 * step:
                    is_floor = shapely.intersects_xy(level.polygon, x, y)
                    if is_floor and self.belongs(one, level.index, x, y, criteria=True):
                        points.append((level.index, x, y))
        kinds = {}
        for level, x, y in points:
            same = level, *(self.inside(name, level, x, y) for name in self.areas)
            kinds.setdefault(same, [0, (level, x, y)])[0] += 1
        each = sorted((self.met(one, *place), count) for count, place in kinds.values())
        reached = np.cumsum([count for _, count in each]) >= one["share"] * len(points) - 1e-9
        return each[int(np.argmax(reached))][0] if each else np.inf

    def required(self, one):
        """Return when the last person who belongs to it has left it, by recorded states."""
        left = {}
        for p in range(self.run.number_of_people):
            states = [(t, *self.at(k, p)) for k, t in enumerate(self.run.time) if self.run.level[k, p] >= 0]
            begins = self.belongs(one, *states[0][1:])
            here = [
                t
                for t, *place in states
                if self.belongs(one, *place)
                and (begins or one["everybody"] or (self.stair(place[0]) and "stair" in one["of"]))
            ]
            if here:
                left[p] = here[-1]
        return left

    def at(self, k, p):
        return int(self.run.level[k, p]), *self.run.position[k, p].tolist()

    def least(self, p, every):
        margins = [np.inf]
        for k in range(0, len(self.run), every):
            if self.run.level[k, p] >= 0:
                place, now, dose = self.at(k, p), float(self.run.time[k]), float(self.run.dose[k, p])
                own = [one for one in self.table["compartment"] if self.belongs(one, *place, criteria=True)]
                for one in own:
                    reached = np.flatnonzero(self.run.dose[: k + 1, p] >= one["fed"])
                    before = self.run.time[reached[0]] if len(reached) else np.inf
                    margins.append(min(before, self.met(one, *place, dose, now)) - now)
        return min(margins)


def check(seed, folder):
    table = random_case(seed)
    results = evac.run(table, folder)
    recount, factor, worst = Recount(table, results), table["safety"]["factor"], []
    for one, row in zip(table["compartment"], results.safety["compartments"], strict=True):
        available = recount.available(one)
        if np.isinf(available):
            assert row["available"] is None
            assert row["until"] == pytest.approx(80.0 * factor)
        else:
            assert row["available"] == pytest.approx(available, abs=0.2, rel=0.005)
        left = recount.required(one)
        assert row["people"] == len(left)
        assert row["required"] == (pytest.approx(max(left.values()), abs=0.21) if left else None)
        if left:
            limit = row["until"] if row["available"] is None else row["available"]
            worst.append((limit - factor * row["required"], limit - row["required"]))
    found = results.margins["least_margin"]
    least = np.array([recount.least(p, 5) for p in range(results.number_of_people)])
    for p in np.flatnonzero(~np.isclose(np.nan_to_num(found, nan=np.inf), least, rtol=0.0, atol=0.2)):
        least[p] = recount.least(p, 1)  # who was at a worse place in between
    np.testing.assert_allclose(np.nan_to_num(found, nan=np.inf), least, rtol=0.0, atol=0.2)
    with_factor, margin = min(worst)
    status = "green" if with_factor >= 0.0 else "amber" if margin >= 0.0 else "red"
    assert results.verdict["status"] == status
    assert results.verdict["margin_with_factor"] == pytest.approx(with_factor)
    again = evac.read_results(folder)
    assert (again.verdict, again.safety) == (results.verdict, results.safety)
    np.testing.assert_array_equal(again.margins["least_margin"], found)
    assert json.loads((folder / "summary.json").read_text())["verdict"] == results.verdict


@pytest.mark.parametrize("seed", range(2))
def test_times_and_margins_are_those_of_recorded_positions(tmp_path, seed):
    check(seed, tmp_path / "r")


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(2, 200))
def test_times_and_margins_of_many_random_cases(tmp_path, seed):
    check(seed, tmp_path / "r")


def test_without_compartments_each_storey_and_stair_is_one_with_those_who_start_there_and_the_building_for_all():
    people = [{"name": "up", "level": "up", "number": 3}, {"name": "down", "level": "down", "number": 2}]
    tables = {"building": {"plan": two_storeys()}, "people": people, "safety": {"available": 30.0}}
    results = Simulation(corridor(**tables)).run()
    rows = {row["name"]: row for row in results.safety["compartments"]}
    assert {name: row["people"] for name, row in rows.items()} == {"down": 2, "up": 3, "stair": 3, "building": 5}
    assert rows["stair"]["required"] == results.stairs["stair"]["last_left"]
    assert rows["up"]["required"] == results.levels["up"]["last_left"]
    assert rows["down"]["required"] < results.levels["down"]["last_left"]
    assert results.verdict["compartment"] == "building"
    assert rows["building"]["required"] == results.last_out


def test_by_hand_a_verdict_has_words_for_each_status():
    def verdict(required, available=100.0, **more):
        row = {"name": "f", "people": 1, "required": required, "available": available, "criterion": "available"}
        return verdict_of({"factor": 2.0, "compartments": [row | {"until": None} | more]})

    assert [verdict(time)["status"] for time in (50.0, 100.0, 101.0, None)] == ["green", "amber", "red", "red"]
    words = [verdict(time)["text"].split(":")[0] for time in (50.0, 51.0, 101.0)]
    assert words == ["In time", "In time, but not with the safety factor", "NOT in time"]
    assert verdict(50.0, None, until=90.0)["status"] == "amber"
    assert (verdict_of(None)["status"], verdict(0.0, people=0)["status"]) == ("none", "none")


@pytest.mark.parametrize(("limit", "values"), [("temperature", [20.0, 100.0]), ("layer", [3.0, 0.0]), ("fic", None)])
def test_temperature_layer_and_irritants_are_criteria(limit, values):
    given = {limit: values} if values else {"hcl": [0.0, 900.0]}
    smoke = prescribed(times=[0, 20], values=given, hold=True)
    edge = {"temperature": 60.0, "layer": 1.5, "fic": 0.5}[limit]
    place = ((90.0, 1.0),)  # irritants would slow who comes from afar
    case = corridor(smoke, positions=place, smoke={"law": "none", "routes": False}, safety={limit: edge})
    (row,) = Simulation(case).run().safety["compartments"]
    assert (row["available"], row["criterion"]) == (pytest.approx(10.0), limit)


def test_people_who_stay_and_take_a_dose_have_the_margin_of_the_own_dose():
    gas = prescribed(values={"co": 20000.0})
    dose = {"heat": "none", "without": ["co2", "o2"], "threshold": 100.0}
    tables = {"smoke": {"law": "none"}, "simulation": {"duration": 60.0}, "safety": {"fed": 0.3}}
    late = {"behaviours": {"response_time": {"time": 100.0}}}
    case = corridor(gas, dose=dose, **tables, **late)
    results = Simulation(case).run()
    rate = 3.317e-5 * 20000.0**1.036 * 25.0 / 30.0 / 60.0
    assert results.safety["compartments"][0]["available"] == pytest.approx(0.3 / rate, rel=1e-5)
    assert results.margins["least_margin"][0] == pytest.approx(0.3 / rate - 60.0, abs=0.2)


def test_check_shows_until_when_compartments_are_available(capsys):
    two = [{"name": "f"}, {"name": "west", "of": ["f"], "available": 7.0}]
    smoke = prescribed(times=[0, 20], values={"extinction": [0.0, 0.2]}, hold=True)
    case = corridor(smoke, safety={"visibility": 10.0, "factor": 2.0}, compartment=two, simulation={"duration": 50.0})
    show_available(Simulation(case, will_run=False))
    rows = [line.split() for line in capsys.readouterr().out.splitlines()]
    assert ["f", "at", "least", "100", "-"] in rows
    assert ["west", "7", "given"] in rows


@pytest.mark.parametrize(
    ("tables", "words"),
    [
        ({"safety": {}}, "no criterion"),
        ({"safety": {"visibility": 10.0}}, "provides extinction"),
        ({"safety": {"fed": 0.3}}, r"table \[dose\]"),
        ({"compartment": [{"name": "f", "available": 1.0}]}, r"table \[safety\]"),
        ({"safety": {"available": 1.0}, "compartment": [{"name": "g"}]}, r"compartment\.g\.of: there is no level"),
    ],
)
def test_wrong_limits_are_refused(tables, words):
    with pytest.raises(ScenarioError, match=words):
        Simulation(corridor(**tables))


def test_runs_that_share_a_scene_share_the_floors_of_their_compartments():
    """They depend on neither seed nor limits, but on the compartments."""
    case, other = random_case(1), random_case(1)
    first = Simulation(case)
    scene = first.scene.shared_scene
    for compartment in other["compartment"]:
        compartment["visibility"] = 3.0
    other["simulation"]["seed"] = 2
    alone, shared = Simulation(other).run(), Simulation(other, shared_scene=scene).run()
    assert len(scene.floors) == 1
    assert shared.safety == alone.safety
    other["compartment"][0]["of"] = ["up"]
    Simulation(other, shared_scene=scene)
    assert len(scene.floors) == 2
