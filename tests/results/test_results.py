import csv
import json
from dataclasses import replace

import numpy as np
import pytest

from evac.base.errors import ResultError
from evac.building.model.building import Door
from evac.case.loading import load_case
from evac.contract.registry import Registry
from evac.directions.routes import Route
from evac.folder.jsonfile import plain
from evac.people.behaviour import Behaviour
from evac.physics.contact.model import ContactModel
from evac.results.results import versions
from evac.results.watch import Observation


def test_counts_and_exit_status(results):
    assert (results.number_of_people, results.evacuated, results.last_out, results.exit_status) == (5, 2, 9.0, 3)
    everybody = results.crowd.replace(exit_time=np.arange(5.0))
    assert replace(results, crowd=everybody).exit_status == 0
    nobody = results.crowd.replace(exit_time=np.full(5, np.nan))
    assert replace(results, crowd=nobody).last_out is None


def test_who_left_by_an_exit_that_the_route_does_not_name_is_counted(results, make_results):
    assert results.summary()["left_by_other_exits"] == 0
    door = results.building.exits[0]
    building = replace(results.building, exits=(door, replace(door, index=1, name="window")))
    routes = (Route(("window",)), *results.routes[1:])
    pushed = make_results(building=building, routes=routes)
    by_first = np.flatnonzero((results.crowd.exit_used == 0) & (results.crowd.route == 0))
    assert by_first.size
    assert pushed.left_by_other_exits.tolist() == by_first.tolist()
    assert any("outside their route" in line and f"{by_first.size} p" in line for line in pushed.remarks)


def test_doors_between_rooms_are_in_the_summary(results, make_results):
    assert results.summary()["doors"] == []
    door = Door("inner", 0, np.array([1.0, 1.0, 1.0, 1.9]), 0.9)
    with_door = make_results(building=replace(results.building, doors=(door,)))
    name = results.building.levels[0].name
    assert with_door.summary()["doors"] == [{"name": "inner", "level": name, "width": 0.9}]


def test_people_who_rush_out_have_a_warning(results, make_results, monkeypatch):
    monkeypatch.setattr("evac.analysis.flows.FEWEST", 5)
    for seconds, warned in ((0.4, False), (0.3, True)):
        rush = results.crowd.replace(exit_time=seconds * np.arange(5.0), exit_used=np.zeros(5, np.int32))
        lines = make_results(crowd=rush).summary()["quality_warnings"]
        assert any("'door'" in line for line in lines) == warned


class Gaps(Behaviour):
    """A user's own behaviour with which people keep distances."""

    name = "gaps"
    keeps_distance = True

    def act(self, crowd, time):
        """Do nothing."""


@pytest.mark.parametrize(("name", "advised"), [("headway", False), ("gaps", False), ("route_choice", True)])
@pytest.mark.parametrize("values", [{}, False])
def test_behaviours_that_keep_distances_are_recommended_where_none_is_in_use(make_results, name, advised, values):
    registry = Registry()
    registry.add_class(Gaps)
    registry.add_class(type("Stiff", (ContactModel,), {"name": "stiff", "rigid": True, "step": lambda *_: None}))
    case = load_case("square_room", {f"behaviours.{name}": values, "contact.model": "nsm1"}, registry=registry)
    pressed = Observation(3, 2.0, 8.0, 4.0, 6.0, 3, 4, 2.0, 5.0, (0.9, 0.2))
    loose = make_results(case=case, crushing=pressed, chatter=pressed)
    chatter, crushing = loose.quality_warnings
    assert "(--set contact.model=stiff)" in chatter  # the model in use is not recommended
    settings = "--set behaviours.walking={} or behaviours.headway={} or behaviours.gaps={}"  # that of new cases first
    assert (settings in crushing) == (advised or values is False)
    assert loose.summary()["keeps_distance"] == ([] if advised or values is False else [name])


def test_egress_counts_exit_times_in_order(results):
    time, number = results.egress()
    assert (time.tolist(), number.tolist()) == ([0.0, 4.0, 9.0], [0, 1, 2])
    time, number = results.egress(results.groups[1].rows)
    assert (time.tolist(), number.tolist()) == ([0.0], [0])


def test_quality_warnings_are_in_the_summary(results, make_results, tmp_path):
    assert results.quality_warnings == ()
    noticed = Observation(3, 2.0, 8.0, 4.0, 6.0, 3, 4, 2.0, 5.0, (0.9, 0.2))
    deep = results.report | {"greatest_overlap": 0.15}
    warned = make_results(report=deep, chatter=noticed, crushing=noticed)
    warned.write(tmp_path / "r")
    lines = json.loads((tmp_path / "r" / "summary.json").read_text())["quality_warnings"]
    assert lines == list(warned.quality_warnings)
    assert len(lines) == 3
    assert "level 'floor 1'" in lines[0]
    assert all("person 3 at (2.00, 5.00) on level 'floor 2'" in line for line in lines[1:])


def test_folder_holds_summary_egress_and_people(results, tmp_path):
    results.write(tmp_path / "new" / "result")
    folder = tmp_path / "new" / "result"
    summary = json.loads((folder / "summary.json").read_text())
    assert summary["title"] == "Three storeys"
    assert (summary["people"], summary["evacuated"], summary["last_out"]) == (5, 2, 9.0)
    assert (summary["ended"], summary["exit_status"], summary["seed"]) == ("no progress", 3, 7)
    assert (summary["simulated_time"], summary["steps"]) == (20.0, 2000)
    assert summary["stuck"] == [{"person": 3, "level": "floor 2", "x": 2.0, "y": 5.0}]
    assert summary["warnings"] == ["a narrow place"]
    door = {"people": 2, "last_out": 9.0, "width": 1.0, "flow": None, "flow_per_metre": None}
    assert summary["exits"] == {"door": door}
    assert summary["portals"]["portal 3"] == {"levels": ["flight 2", "floor 2"], "width": 2.0, "passages": 3}
    assert (summary["contact"]["greatest_overlap"], summary["contact"]["residual"]) == (1e-4, None)
    assert summary["quality_warnings"] == []
    assert summary["wall_time"] == {"contact": 1.5}
    assert summary["plan"] == [{"part": "social force", "state": "out", "why": "no force is in use"}]
    assert summary["plugins"] == ["dem"]
    assert summary["metrics"] == {"density": {"greatest": 3.0}}
    assert summary["versions"] == versions()
    with (folder / "egress.csv").open() as file:
        assert list(csv.reader(file)) == [["time", "number_out"], ["0.0", "0"], ["4.0", "1"], ["9.0", "2"]]
    with (folder / "people.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [row["person"] for row in rows] == ["0", "1", "2", "3", "4"]
    assert [row["group"] for row in rows] == ["low", "low", "high", "", "high"]
    crowd = results.crowd
    for column, values in (
        ("radius", crowd.radius),
        ("height", crowd.height),
        ("mass", crowd.mass),
        ("tau", crowd.tau),
    ):
        assert [float(row[column]) for row in rows] == values.tolist()
    for k, column in enumerate(("speed", "speed_up", "speed_down")):
        assert [float(row[column]) for row in rows] == crowd.speed[:, k].tolist()
    assert rows[1] == {
        "person": "1",
        "group": "low",
        "start_x": "2.0",
        "start_y": "3.0",
        "start_level": "floor 1",
        "radius": "0.2",
        "height": "1.7",
        "mass": "80.0",
        "tau": "0.5",
        "speed": "1.0",
        "speed_up": "0.6",
        "speed_down": "0.8",
        "arrival_time": "0.0",
        "response_time": "1.5",
        "route": "shortest to door",
        "exit": "door",
        "exit_time": "9.0",
        "distance": "10.0",
        "end_x": "0.0",
        "end_y": "1.5",
        "end_level": "",
    }
    assert (rows[2]["exit"], rows[2]["exit_time"]) == ("", "")
    with (folder / "crossings.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert rows[1] == {"person": "1", "portal": "portal 1", "time": "2.0"}
    assert len(rows) == 6


def test_summary_tells_the_use_of_levels_and_stairs(results):
    summary = results.summary()
    assert summary["levels"]["floor 0"] == {"people": 2, "greatest_number": 1, "last_left": 9.0}
    assert summary["levels"]["floor 1"] == {"people": 2, "greatest_number": 1, "last_left": None}
    assert summary["levels"]["floor 2"] == {"people": 3, "greatest_number": 3, "last_left": None}
    assert summary["stairs"]["lower"] == {"people": 1, "greatest_number": 1, "last_left": 6.0}
    assert summary["stairs"]["upper"] == {"people": 2, "greatest_number": 2, "last_left": 5.0}


def test_route_in_words():
    assert str(Route(exits=("north", "south"), strategy="fastest")) == "fastest to north|south"
    assert str(Route()) == "fastest to any exit"


def test_plain_makes_json_of_numpy():
    value = {"a": np.float32(0.5), "b": np.array([1.0, np.inf]), "c": (np.int32(2), np.bool_(True)), 3: None}
    assert plain(value) == {"a": 0.5, "b": [1.0, None], "c": [2, True], "3": None}


def test_unwritable_folder_is_named(results, tmp_path):
    (tmp_path / "taken").write_text("a file")
    with pytest.raises(ResultError, match="taken: "):
        results.write(tmp_path / "taken")
