"""A bare surface, run with nothing added but an exit, people and a duration."""

import numpy as np
import pytest

from evac.case.loading import load_case
from evac.simulation.simulation import Simulation
from tests.ustair import SHORTEST, write_u_stair
from tests.validation.buildings import crossing_times, track

CASE = """
[building]
mesh = {mesh!r}

[[building.exits]]
name = "out"
segment = [[0.0, 5.0], [0.0, 7.0]]
z = 0.0

[[people]]
name = "visitors"
positions = {positions}
z = 3.25

[contact]
model = "{model}"

[simulation]
duration = 240.0
"""


@pytest.fixture
def make(tmp_path):
    """Return a simulation of the file as it is."""
    mesh = write_u_stair(tmp_path / "u_stair.obj")

    def simulation(positions, model="nsm2", **changes):
        path = tmp_path / "case.toml"
        path.write_text(CASE.format(mesh=str(mesh), positions=positions, model=model), encoding="utf-8")
        return Simulation(load_case(path, changes))

    return simulation


def crosses_the_wall(before, after):
    """Say which steps pass the wall between the flights, y = 8 for 7 < x < 12."""
    rise = after[:, 1] - before[:, 1]
    with np.errstate(divide="ignore", invalid="ignore"):
        share = (8.0 - before[:, 1]) / rise
        x = before[:, 0] + share * (after[:, 0] - before[:, 0])
    return (share >= 0.0) & (share <= 1.0) & (x > 7.0) & (x < 12.0)


@pytest.mark.parametrize("model", ["dem", "nsm1", "nsm2"])
def test_everybody_takes_the_four_portals_in_order(make, model):
    random = np.random.default_rng(5)
    positions = [[0.6 + 0.7 * i + random.uniform(0, 0.1), 8.0 + 0.7 * j] for i in range(3) for j in range(10)]
    simulation = make(positions, model)
    assert (len(simulation.building.levels), len(simulation.building.portals)) == (5, 4)
    before = simulation.population.crowd.position.copy()
    for _, crowd in track(simulation):
        assert not crosses_the_wall(before, crowd.position)[crowd.level >= 0].any()
        before = crowd.position.copy()
    assert simulation.ended == "everybody out"
    chain = [portal for portal, _ in crossing_times(simulation, 0)]
    levels = [simulation.building.portals[portal].levels for portal in chain]
    assert levels == [(3, 4), (2, 3), (1, 2), (0, 1)]
    for person in range(len(positions)):
        first_time = list(dict.fromkeys(portal for portal, _ in crossing_times(simulation, person)))
        assert first_time == chain


@pytest.mark.parametrize(("start", "speed"), [([2.0, 11.5], 0.5), ([6.0, 9.5], 1.4)])
def test_a_person_alone_takes_the_stair_by_its_shortest_way(make, speed, start):
    """With tau = 0.1 s: turning round the end of the wall takes who is slower to turn up to 10 % longer."""
    changes = {f"people.visitors.{key}": speed for key in ("speed", "speed_up", "speed_down")}
    simulation = make([start], **changes | {"people.visitors.tau": 0.1})
    simulation.run()
    (head, *_, foot) = crossing_times(simulation)
    assert (head[0], foot[0]) == (3, 0)
    assert SHORTEST / speed <= foot[1] - head[1] <= 1.15 * SHORTEST / speed
