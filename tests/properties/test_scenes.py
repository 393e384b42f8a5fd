"""Random scenes: random buildings and people, with any model, run for a while: no NaN, and nobody is lost."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely

import evac
from evac.base.errors import EvacError
from tests.properties.random_meshes import KINDS, random_mesh
from tests.properties.seeded import MODELS, drawn

#: Kinds of meshes that buildings can be made of, in turn; `tests.properties.test_random_meshes` has the others.
BUILT = ("storeys", "plan", "fan", "triangulation", "with gaps", "jitter", "far", "damaged storeys", "soup")

#: How far rounding, or a body that is pushed, may bring a centre beyond the outline of its level [m].
BEYOND = 0.05


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("kind", BUILT)
@drawn(1)
def test_nobody_is_lost(kind, seed, tmp_path_factory):
    check(seed % 1000 * len(KINDS) + list(KINDS).index(kind), tmp_path_factory.mktemp("scene"))


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("seed", [18118, 18164, pytest.param(18762, marks=pytest.mark.slow)])
def test_nobody_is_lost_where_somebody_once_was(seed, tmp_path):
    check(seed, tmp_path)


def check(seed: int, tmp_path: Path) -> None:
    """Run a random scene: everybody is inside, on a level, or out."""
    generator = np.random.default_rng(seed)
    mesh = random_mesh(seed).write(tmp_path)
    try:
        building = evac.read_building(mesh, need_exit=False)
        loaded = evac.load(_table(generator, building, mesh))
        simulation = evac.Simulation(loaded)
    except EvacError:
        return
    people = len(simulation.population.crowd.level)
    try:
        results = simulation.run()
    except EvacError:
        return
    crowd = results.crowd
    inside, out = crowd.level >= 0, np.isfinite(crowd.exit_time)
    assert (inside != out).all(), "somebody is neither inside nor out"
    assert len(inside) == people
    assert results.exit_status == (3 if inside.any() else 0), results.exit_status
    for name in ("position", "velocity", "contact_force", "distance"):
        values = getattr(crowd, name)
        assert np.isfinite(values[inside]).all(), f"{name} is not finite"
    for level in simulation.building.levels:
        here = crowd.position[crowd.level == level.index]
        distance = shapely.distance(level.polygon, shapely.points(here)).max(initial=0.0)
        assert distance < BEYOND, f"a centre is {distance:.3f} m beyond level {level.name!r}"


def _table(generator: np.random.Generator, building: evac.Building, mesh: Path) -> dict[str, Any]:
    """Return a case with exits at walls of the building and people on its levels."""
    walls = building.walls
    lengths = np.hypot(*(walls[:, 2:] - walls[:, :2]).T)
    wide = np.flatnonzero(lengths > 0.5)
    exits = [
        {
            "name": f"exit {k}",
            "segment": [walls[row, :2].tolist(), walls[row, 2:].tolist()],
            "level": building.levels[int(building.wall_level[row])].name,
        }
        for k, row in enumerate(generator.permutation(wide)[: generator.choice([1, 4, 12])])
    ]
    behaviours = {
        "response_time": {"time": {"uniform": [0.0, 2.0]}},
        "route_choice": {"every": 1.0, "strategies": ["fastest", "shortest"]},
        "headway": {},
    }
    step = float(generator.choice([0.001, 0.005, 0.01, 0.02]))
    return {
        "building": {"mesh": str(mesh), "exits": exits},
        "directions": {"spacing": float(generator.choice([0.1, 0.2]))},
        "people": _groups(generator, building),
        "contact": {"model": str(generator.choice(MODELS))},
        "forces": {"social": {}} if generator.random() < 0.3 else {},
        "behaviours": {name: table for name, table in behaviours.items() if generator.random() < 0.3},
        "simulation": {"step": step, "duration": 4.0, "seed": int(generator.integers(10**6))},
    }


def _groups(generator: np.random.Generator, building: evac.Building) -> list[dict[str, Any]]:
    """Return groups at places that may overlap, with people of all kinds."""
    groups: list[dict[str, Any]] = []
    for level in building.levels:
        count = int(generator.choice([1, 5, 25, 60]))
        radius = float(generator.choice([0.05, 0.2, 0.25, 0.3]))
        ground = level.polygon.buffer(-radius - 0.01)
        if not count or ground.is_empty:
            continue
        left, bottom, right, top = ground.bounds
        points = generator.uniform((left, bottom), (right, top), (50 * count, 2))
        points = points[shapely.intersects_xy(ground, points[:, 0], points[:, 1])][:count]
        if not len(points):
            continue
        groups.append(
            {
                "name": f"on {level.index}",
                "level": level.name,
                "positions": points.tolist(),
                "velocity": generator.normal(0.0, 1.0, points.shape).clip(-5.0, 5.0).tolist(),
                "radius": radius,
                "mass": float(generator.choice([20.0, 80.0, 200.0])),
                "tau": float(generator.choice([0.1, 0.5, 1.0])),
                "speed": float(generator.choice([0.0, 0.5, 1.3, 3.0])),
                "strategy": str(generator.choice(["fastest", "shortest", "comfortable"])),
            }
        )
    return groups
