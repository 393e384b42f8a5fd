"""Strategies in twin towers and flows of escalators, as the page on lifts measures them."""

import pytest

from evac.evidence.lifts import page


@pytest.mark.slow
def test_each_strategy_brings_people_out_by_the_ways_that_it_names():
    rows = {name: page.strategy_run(name, 3, 1) for name in (page.STAIRS, page.LIFTS)}
    people = 2 * page.PEOPLE
    assert {name: row["by lift"] for name, row in rows.items()} == {page.STAIRS: 0, page.LIFTS: people}
    assert all(0.0 < row["mean exit time [s]"] < row["last out [s]"] < 300.0 for row in rows.values())


def test_the_flow_of_people_who_stand_on_an_escalator_is_below_its_capacity():
    flow = page.escalator_flow(1.0, 0.5, 0.0, 1)
    assert 0.8 * page.CAPACITY[1.0][0.5] < flow < page.CAPACITY[1.0][0.5]
