"""Halls of any size, and where the time of a step goes."""

import math

import numpy as np
import pytest

from evac.evidence import scaling
from evac.evidence.halls import DOOR, RADIUS, make_hall
from evac.evidence.models import make_model
from evac.evidence.report import Evidence
from evac.evidence.scaling import PER_TICK, PHASES, STEP, memory, phase_times, walk


def gaps(crowd):
    apart = np.linalg.norm(crowd.position[:, None] - crowd.position[None], axis=2)
    apart -= crowd.radius[:, None] + crowd.radius[None]
    return apart[np.triu_indices(len(crowd.radius), 1)]


@pytest.mark.parametrize("density", [2.0, 5.0])
@pytest.mark.parametrize("people", [20, 400])
def test_hall_holds_its_people_without_overlap(people, density):
    hall = make_hall(people, density, seed=1)
    crowd = hall.crowd
    assert len(crowd.level) == people
    assert gaps(crowd).min() >= 0.0
    assert (crowd.position > crowd.radius[:, None]).all()
    assert (crowd.position < hall.side - crowd.radius[:, None]).all()
    assert crowd.radius.min() >= RADIUS[0]
    assert np.isfinite(hall.fields.travel_time_at(0, crowd.position, 0)).all()


def test_density_is_reached_as_halls_grow():
    for density in (2.0, 5.0):
        shares = [people / make_hall(people, density, 1).side ** 2 / density for people in (20, 200, 2000)]
        assert shares == sorted(shares)
        assert 0.94 < shares[-1] <= 1.0


def test_walls_and_doors_close_the_hall():
    hall = make_hall(2000, 2.0, seed=1)
    walls = sum(math.dist(wall[:2], wall[2:]) for wall in hall.building.walls)
    doors = sum(exit_.width for exit_ in hall.building.exits)
    assert len(hall.building.exits) == 3
    assert doors == pytest.approx(3 * DOOR)
    assert walls + doors == pytest.approx(4.0 * hall.side)


def test_same_seed_gives_the_same_hall():
    one, two, other = make_hall(50, 2.0, 1), make_hall(50, 2.0, 1), make_hall(50, 2.0, 2)
    assert np.array_equal(one.crowd.position, two.crowd.position)
    assert not np.array_equal(one.crowd.position, other.crowd.position)


@pytest.mark.parametrize("name", scaling.MODELS)
def test_phases_share_the_step_and_leave_the_crowd_alone(name):
    done = walk(make_hall(100, 2.0, 1), make_model(name), warm=3, timed=2)
    before = done.crowd.position.copy(), done.crowd.velocity.copy(), done.crowd.level.copy()
    spent = phase_times(done)
    assert tuple(spent) == PHASES
    assert min(spent.values()) >= 0.0
    assert spent["contact and rest"] == pytest.approx(
        max(0.0, done.seconds - sum(spent[phase] for phase in PHASES if phase != "contact and rest"))
    )
    for array, old in zip((done.crowd.position, done.crowd.velocity, done.crowd.level), before, strict=True):
        assert np.array_equal(array, old)


def test_walking_is_the_same_walk_every_time():
    hall = make_hall(100, 5.0, 1)
    ends = [walk(hall, make_model("NSM2"), warm=2, timed=1).crowd.position for _ in range(2)]
    assert np.array_equal(*ends)
    assert not np.array_equal(ends[0], hall.crowd.position)
    assert np.abs(ends[0] - hall.crowd.position).max() < 2.5 * 3 * PER_TICK * STEP


def test_memory_grows_with_the_people_alone():
    small, large = (walk(make_hall(people, 2.0, 1), make_model("DEM"), warm=1, timed=1) for people in (200, 2000))
    assert 8 < memory(large.engine, large.crowd) / memory(small.engine, small.crowd) <= 10


def test_page_is_written(tmp_path, monkeypatch):
    monkeypatch.setattr(scaling, "QUICK_SIZES", {20: (1, 1), 50: (1, 1)})
    monkeypatch.setattr(scaling, "_school_claims", lambda repeats: [])
    evidence = Evidence("scaling", tmp_path, quick=True)
    scaling.run(evidence)
    names = {path.name for path in tmp_path.iterdir()}
    assert names == {"README.md", "run.json", "claims.csv", "scaling.csv", "scaling.png", "phases.csv", "phases.png"}
    rows = np.genfromtxt(tmp_path / "phases.csv", delimiter=",", names=True, usecols=range(3, 3 + len(PHASES)))
    assert np.allclose([sum(row) for row in rows.tolist()], 100.0)
    assert len(rows) == 2 * 2 * len(scaling.MODELS)
