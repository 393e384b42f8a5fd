import json
from dataclasses import replace

import numpy as np
import pytest
from shapely import box

import evac
from evac.case.loading import load_case
from evac.contract.registry import Registry
from evac.directions.routes import Route
from evac.people.behaviour import Behaviour
from evac.physics.contact.model import ContactModel
from evac.results.ending import Observation


def test_counts_and_exit_status(results):
    assert (results.number_of_people, results.evacuated, results.last_out, results.exit_status) == (5, 2, 9.0, 3)
    everybody = results.crowd.replace(exit_time=np.arange(5.0))
    assert replace(results, crowd=everybody).exit_status == 0
    nobody = results.crowd.replace(exit_time=np.full(5, np.nan))
    assert replace(results, crowd=nobody).last_out is None
    assert (results.leaving.tolist(), results.not_arrived) == ([0, 1, 2, 3, 4], 0)
    late = results.crowd.replace(arrival_time=np.array([0.0, 0.0, np.nan, 0.0, 0.0]))
    late = replace(results, crowd=late)
    assert (late.leaving.tolist(), late.not_arrived) == ([0, 1, 3, 4], 1)


def test_who_left_by_an_exit_that_the_route_does_not_name_is_counted(results, make_results):
    assert results.summary()["left_by_other_exits"] == 0
    door = results.building.exits[0]
    building = replace(results.building, exits=(door, replace(door, index=1, name="window")))
    routes = (Route(("window",)), *results.routes[1:])
    pushed = make_results(building=building, routes=routes)
    by_first = np.flatnonzero((results.crowd.exit_used == 0) & (results.crowd.route == 0))
    assert by_first.size
    assert pushed.left_by_other_exits.tolist() == by_first.tolist()
    crowd = results.crowd.replace(exit_used=np.where(results.crowd.exit_used == 0, 1, results.crowd.exit_used))
    by_second = make_results(building=building, routes=results.routes, crowd=crowd)
    assert by_second.left_by_other_exits.tolist() == np.flatnonzero(results.crowd.exit_used == 0).tolist()
    assert any("outside their route" in line and f"{by_first.size} p" in line for line in pushed.remarks)


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
    loose = make_results(case=case, seen={"crushing": pressed, "chatter": pressed})
    chatter, crushing = loose.quality_warnings
    assert "contact.model=stiff)" in chatter  # the model in use is not recommended
    settings = "behaviours.walking={} or behaviours.headway={} or behaviours.gaps={}"  # that of new cases first
    assert (settings in crushing) == (advised or values is False)
    assert loose.summary()["keeps_distance"] == ([] if advised or values is False else [name])


def test_quality_warnings_are_in_the_summary(results, make_results, tmp_path):
    assert results.quality_warnings == ()
    noticed = Observation(3, 2.0, 8.0, 4.0, 6.0, 3, 4, 2.0, 5.0, (0.9, 0.2))
    deep = results.report | {"greatest_overlap": 0.15}
    warned = make_results(report=deep, seen={"chatter": noticed, "crushing": noticed})
    warned.write(tmp_path / "r")
    lines = json.loads((tmp_path / "r" / "summary.json").read_text())["quality_warnings"]
    assert lines == list(warned.quality_warnings)
    assert len(lines) == 3
    assert "level 'floor 1'" in lines[0]
    assert all("person 3 at (2.00, 5.00) on level 'floor 2'" in line for line in lines[1:])


def test_phases_have_those_who_start_in_their_places():
    plan = evac.Plan()
    for k in range(2):
        plan.storey(f"s{k}", box(0, 0, 10, 6), z=3.0 * k)
        plan.area(f"west {k}", f"s{k}", box(0, 2, 4, 6))
        plan.exit(f"door {k}", f"s{k}", [(10, 2), (10, 4)])
    people = [{"name": f"{k}", "number": 2 + k, "area": f"west {k}"} for k in range(2)]
    phases = [{"name": "upper", "of": ["west 1"], "delay": 2.0}, {"name": "lower", "of": ["s0"], "delay": 4.0}]
    table = {"building": plan, "people": people, "phase": phases, "contact": {"model": "nsm2"}}
    results = evac.run(evac.load(table | {"behaviours": {"response_time": {}}}), progress=False)
    found = {phase["name"]: (phase["people"], phase["alarm"], [*phase["clear"]]) for phase in results.phase}
    assert found == {"upper": (3, 2.0, ["s1"]), "lower": (2, 4.0, ["s0"])}


def test_stairs_have_their_pieces_and_the_portals_between_them_alone():
    plan = evac.Plan()
    plan.storey("low", box(0, 0, 8, 4))
    plan.storey("high", box(13, 0, 20, 4), z=2.0)
    plan.stair("east", "low", [(8, 2.5), (8, 3.5)], "high", [(13, 2.5), (13, 3.5)], landing=1.2)
    plan.flight("west", [(8, 0.5), (8, 1.5)], 0.0, [(12, 0.5), (12, 1.5)], 2.0)
    plan.landing("west", box(12, 0.5, 13, 1.5), 2.0)
    plan.exit("out", "low", [(0, 0.5), (0, 1.5)])
    people = [{"name": "one", "positions": [[14.0, 1.0]], "level": "high", "speed": 1.5}]
    results = evac.run(evac.load({"building": plan, "people": people, "contact": {"model": "nsm2"}}), progress=False)
    for stair, pieces in (("west", 2), ("east", 3)):
        own = {level.index: level.name for level in results.building.levels if level.stair == stair}
        use = results.stairs[stair]
        assert (len(own), use["people"]) == (pieces, stair == "west")
        assert use["pieces"] == {name: index for index, name in own.items()}
        inner = {one.name: one.index for one in results.building.portals if {*one.levels} <= own.keys()}
        assert use["portals"] == inner
        assert len(inner) == pieces - 1
