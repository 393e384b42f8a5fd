"""Who passed portals and exits, from the levels on which people were recorded."""

import numpy as np
import pytest

from evac.analysis.lines import line_flows


def test_a_descent_passes_every_portal_and_the_door(written):
    level = [[4], [3], [2], [1], [0], [-1]]
    position = [[[9.0, 3.0]], [[12.0, 3.0]], [[15.0, 2.0]], [[12.0, 1.0]], [[1.0, 1.5]], [[0.0, 1.5]]]
    flows = line_flows(written(position, level, interval=2.0))
    times = {name: flow.time.tolist() for name, flow in flows.items()}
    assert times == {"portal 3": [1.0], "portal 2": [3.0], "portal 1": [5.0], "portal 0": [7.0], "door": [9.0]}
    assert [flow.forward.tolist() for flow in flows.values()] == [[False], [False], [False], [False], [True]]
    assert all(flow.flow is None for flow in flows.values())


def test_levels_skipped_between_two_recorded_times_are_passed(written):
    flows = line_flows(written([[[12.0, 3.0]], [[1.0, 1.5]], [[1.0, 1.0]]], [[3], [0], [-1]]))
    assert {name: flow.people for name, flow in flows.items()} == {
        "portal 0": 1,
        "portal 1": 1,
        "portal 2": 1,
        "portal 3": 0,
        "door": 1,
    }


def test_there_and_back_counts_twice(written):
    flow = line_flows(written(np.full((3, 1, 2), 10.0), [[4], [3], [4]]))["portal 3"]
    assert flow.people == 2
    assert flow.forward.tolist() == [False, True]


def test_a_steady_stream_has_its_rate(written):
    people = 40
    level = [[-1 if p < k else 0 for p in range(people)] for k in range(people + 1)]
    flow = line_flows(written(np.full((people + 1, people, 2), 1.0), level, interval=0.5))["door"]
    assert flow.people == people
    assert flow.flow == pytest.approx(2.0)
    assert flow.flow_per_metre == pytest.approx(2.0 / 1.0)
