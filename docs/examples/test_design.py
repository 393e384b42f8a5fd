"""A design as a test: pytest fixtures run it once, and its requirements are asserted; ``pytest test_design.py``."""

import pytest

import evac

WIDTH = 1.2


@pytest.fixture(scope="session")
def design():
    """Return the case of a room with a door of this width."""
    plan = evac.Plan()
    plan.storey("room", [(0, 0), (8, 0), (8, 6), (0, 6)])
    plan.exit("door", "room", [(0, 3 - WIDTH / 2), (0, 3 + WIDTH / 2)])
    plan.area("seats", "room", [(2, 0.5), (7.5, 0.5), (7.5, 5.5), (2, 5.5)])
    people = [{"name": "guests", "area": "seats", "number": 30}]
    return evac.load({"building": plan, "people": people, "contact": {"model": "nsm2"}, "behaviours": {"walking": {}}})


@pytest.fixture(scope="session")
def study(design):
    """Return a few runs."""
    return evac.repeat(design, 4, workers=1)


@pytest.fixture
def results(design):
    """Return one run with its motion, in memory."""
    return evac.run(design)


def test_everybody_is_out_in_time(study):
    """The slowest run counts."""
    assert max(row["last_out"] for row in study.rows()) < 60.0


def test_the_interval_of_the_mean_is_narrow(study):
    """Otherwise more runs are needed."""
    mean = study.statistics[0].mean
    assert mean.high - mean.low < 0.5 * mean.value


def test_nobody_is_pressed(results):
    """The greatest density of the maps [1/m2]."""
    density = max(own.density.max() for own in results.trajectory.maps().values())
    assert results.evacuated == 30
    assert density < 8.0


@pytest.mark.parametrize("number", [10, 20])
def test_fewer_people_are_out_earlier(design, results, number):
    """A fixture is changed for one test."""
    fewer = evac.run(design.change({"people.guests.number": number}))
    assert fewer.last_out < results.last_out
