"""Who passed portals, exits, doors and lines, and when."""

from dataclasses import replace

import numpy as np
import pytest
from shapely import LineString

from evac.analysis.lines import exit_table, flow_rows, line_flows, link_flows, moves_of, steady_flow
from evac.building.model.building import Door, Place
from tests.physics.scenes import make_building


def test_steady_flow_leaves_out_both_ends():
    times = np.concatenate([[0.0, 50.0], 100.0 + 0.5 * np.arange(6), [200.0, 300.0]])
    assert steady_flow(times) == pytest.approx(6 / (200.0 - 100.0))
    assert steady_flow(0.25 * np.arange(100)) == pytest.approx(4.0)
    assert np.isnan(steady_flow(np.array([1.0])))


def test_people_who_all_pass_at_once_have_no_flow():
    """A row of equal people who walk abreast through a wide exit."""
    assert np.isnan(steady_flow(np.full(25, 8.75)))
    building = make_building(exits=[(0, (0.0, 0.0, 0.0, 30.0))])
    table = exit_table(building, np.zeros(25, np.int32), np.full(25, 8.75))
    assert table["exit 0"] == {"people": 25, "last_out": 8.75, "width": 1.0, "flow": None, "flow_per_metre": None}


def test_each_exit_has_people_width_and_flow():
    building = make_building(exits=[(0, (0.0, 0.0, 0.0, 1.0)), (0, (5.0, 0.0, 5.0, 1.0)), (0, (9.0, 0.0, 9.0, 1.0))])
    wide = building.exits[1]
    building = type(building)(
        **{
            **building.__dict__,
            "exits": (building.exits[0], type(wide)(**{**wide.__dict__, "width": 2.0}), building.exits[2]),
        }
    )
    used = np.repeat(np.array([0, 1, -1], np.int32), [19, 25, 3])
    times = np.concatenate([np.arange(19.0)[::-1], 10.0 + 0.2 * np.arange(25.0)[::-1], np.full(3, np.nan)])
    table = exit_table(building, used, times)
    assert table["exit 0"] == {"people": 19, "last_out": 18.0, "width": 1.0, "flow": None, "flow_per_metre": None}
    assert table["exit 1"]["last_out"] == pytest.approx(14.8)
    assert (table["exit 1"]["flow"], table["exit 1"]["flow_per_metre"]) == pytest.approx((5.0, 2.5))
    assert table["exit 2"] == {"people": 0, "last_out": None, "width": 1.0, "flow": None, "flow_per_metre": None}


def flows_of(building, start, crossings, exit_time):
    """Return the flows of a log of crossings: person, link and time."""
    person, link, time = (np.array(column) for column in zip(*crossings, strict=True))
    log = person.astype(np.int32), link.astype(np.int32), time.astype(np.float64)
    used = np.zeros(len(start), np.int32)
    moves = moves_of(building, np.array(start, np.int32), log, np.array(exit_time), exit_used=used)
    return {flow.name: flow for flow in link_flows(building, moves)}


def test_passages_through_portals_and_exits_are_those_of_the_log(building):
    down = [(0, 3, 1.0), (0, 2, 3.0), (0, 1, 5.0), (0, 0, 7.0)]
    flows = flows_of(building, [4, 4], [*down[:1], (1, 3, 1.5), (1, 3, 2.0), *down[1:]], [9.0, np.nan])
    times = {name: flow.time.tolist() for name, flow in flows.items()}
    assert times == {
        "portal 0": [7.0],
        "portal 1": [5.0],
        "portal 2": [3.0],
        "portal 3": [1.0, 1.5, 2.0],
        "door": [9.0],
    }
    assert flows["portal 3"].forward.tolist() == [False, False, True]  # the second person goes back
    assert flows["door"].forward.tolist() == [True]
    quiet = {name: getattr(flows["door"], name)[:0] for name in ("person", "time", "forward")}
    assert [(name, len(times)) for name, times in replace(flows["door"], **quiet).by_direction()] == [("out", 0)]
    assert all(flow.flow is None for flow in flows.values())


def test_a_steady_stream_has_its_rate_and_rows(building):
    times = 0.5 * np.arange(1, 25)
    flow = flows_of(building, [4, *[0] * 24], [(0, 3, 0.1)], [np.nan, *times])["door"]
    assert (flow.people, flow.flow, flow.flow_per_metre) == (24, pytest.approx(2.0), pytest.approx(2.0 / 1.0))
    rows = list(flow_rows([flow], 12.0))
    assert [row[0] for row in rows] == [5.0, 10.0, 12.0]
    assert [row[1:5] for row in rows] == [("exit", "door", "out", count) for count in (10, 20, 24)]
    assert [row[5:] for row in rows] == [(2.0, 2.0)] * 3


def passed(trajectory):
    """Return the passages through doors and lines by their names."""
    return {flow.name: flow for flow in line_flows(trajectory)}


def test_lines_and_doors_are_passed_where_and_when_they_are(written):
    # One walks along y = 3 at 1 m/s and back, one beyond the end of the line, one on another level.
    out = [*range(1, 7), 5, 4, 3, 2, 1]
    position = [[[x, 3.0], [x, 5.5], [x, 3.0]] for x in np.array(out) + 0.25]
    trajectory = written(position, [[0, 0, 4]] * len(out))
    line = Place("line", "line", 0, LineString([(3.0, 1.0), (3.0, 5.0)]))
    door = Door(0, "door between", 0, np.array([5.0, 2.0, 5.0, 4.0]), 2.0)
    trajectory = replace(trajectory, building=replace(trajectory.building, places=(line,), doors=(door,)))
    flows = passed(trajectory)
    assert flows["line"].time.tolist() == pytest.approx([1.75, 8.25])
    assert flows["line"].forward.tolist() == [False, True]  # the line points upwards: to the right, then to the left
    assert flows["line"].person.tolist() == [0, 0]
    assert flows["door between"].time.tolist() == pytest.approx([3.75, 6.25])
    assert (flows["line"].width, flows["door between"].kind) == (4.0, "door")


def test_lines_that_share_ends_and_lines_in_reverse_count_each_passage_once(written):
    """The first person passes where two lines meet, the second starts on the lines."""
    trajectory = written([[[2.0, 3.0], [3.0, 2.0]], [[4.0, 3.0], [4.0, 2.0]]], [[0, 0]] * 2)
    ends = {"low": (1, 3), "high": (3, 5), "low back": (3, 1), "high back": (5, 3)}
    places = tuple(Place(name, "line", 0, LineString([(3.0, y) for y in ys])) for name, ys in ends.items())
    flows = passed(replace(trajectory, building=replace(trajectory.building, places=places)))
    assert {name: flows[name].person.tolist() for name in ends} == {
        "low": [1],
        "high": [0],
        "low back": [1],
        "high back": [0],
    }
    assert [flows[name].forward.tolist() for name in ends] == [[False], [False], [True], [True]]


def test_who_leaves_passes_a_line_before_the_exit(written):
    line = Place("line", "line", 0, LineString([(0.5, 0.0), (0.5, 6.0)]))
    trajectory = written([[[1.0, 1.5]], [[1.0, 1.5]]], [[0], [-1]], interval=2.0)
    trajectory = replace(trajectory, building=replace(trajectory.building, places=(line,)))
    assert passed(trajectory)["line"].time.tolist() == [1.0]
