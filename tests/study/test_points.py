"""Points of sweeps and tables, and their seeds."""

import pytest

import evac
from evac.base.errors import ScenarioError
from evac.study.points import Seeds, from_rows, grid, read_table


@pytest.fixture(scope="module")
def case():
    return evac.load("square_room", {"people.people.number": 4})


def test_a_grid_has_all_combinations(case):
    points = grid(case, {"people.people.number": [3, 5], "contact.model": ["dem", "nsm2"]})
    assert [point.parameters["people.people.number"] for point in points] == [3, 3, 5, 5]
    assert [point.case.contact.model for point in points] == ["dem", "nsm2", "dem", "nsm2"]
    assert points[2].label == "people.people.number = 5, contact.model = dem"


def test_a_point_that_is_not_valid_is_named(case):
    with pytest.raises(ScenarioError, match=r"contact\.model") as caught:
        grid(case, {"contact.model": ["dem", "dom"]})
    assert caught.value.__notes__ == ["at the point contact.model = dom"]


def test_runs_of_all_points_have_the_same_seeds():
    assert [Seeds(5).changes(k) for k in range(2)] == [{"simulation.seed": 5}, {"simulation.seed": 6}]
    assert [tuple(Seeds(5, 2).changes(k).values()) for k in range(4)] == [(5, 5), (6, 5), (7, 6), (8, 6)]


def test_repetitions_have_the_same_people_in_other_places(case):
    one, again, other = (evac.Simulation(case.change(Seeds(1, 2).changes(k))).population.crowd for k in range(3))
    assert (one.radius == again.radius).all()
    assert (one.speed == again.speed).all()
    assert (one.position != again.position).any()
    assert (one.radius != other.radius).all()


def test_a_table_of_cases(case, tmp_path):
    path = tmp_path / "points.csv"
    path.write_text("case,people.people.number,contact.model\nsquare_room,3,dem\nclassroom,,nsm1\n,2,\n")
    points = from_rows(case, read_table(path), tmp_path)
    assert [point.case.source.parent.name for point in points] == ["square_room", "classroom", "square_room"]
    assert points[0].case.people[0].count == 3
    assert points[1].parameters == {"case": "classroom", "contact.model": "nsm1"}
    assert points[2].case.people[0].count == 2
    with pytest.raises(ScenarioError, match="row 3"):
        from_rows(None, read_table(path), tmp_path)
