"""Small scenes for physics tests: buildings and crowds made by hand, directions given, no mesh file."""

from pathlib import Path

import numpy as np
from shapely.geometry import box

from evac.building.model.building import Building, Exit, Level, Portal
from evac.contract.registry import Registry
from evac.physics.engine import CompiledEngine
from evac.physics.scenes import one_direction, towards
from evac.physics.state import make_crowd
from evac.physics.world import make_world
from evac_plugins.contact_dem import Dem
from evac_plugins.contact_nsm1 import Nsm1
from evac_plugins.contact_nsm2 import Nsm2

#: The registered solvers, by name.
SOLVERS = Registry().solvers


def flat_level(index, bounds):
    return Level(
        index=index,
        name=f"floor {index}",
        kind="floor",
        stair=None,
        triangles=np.zeros((0, 3), np.int32),
        polygon=box(*bounds),
        uphill=np.zeros(2),
        slope=0.0,
        z_min=0.0,
        z_max=0.0,
    )


def make_building(bounds=((-10.0, -10.0, 10.0, 10.0),), walls=(), wall_level=None, portals=(), exits=()):
    """Flat levels of the given plan bounds, with walls, portals (a, b, segment) and exits (level, segment)."""
    walls = np.array(walls, dtype=float).reshape(-1, 4)
    return Building(
        source=Path("by hand"),
        vertices=np.zeros((0, 3)),
        levels=tuple(flat_level(k, bound) for k, bound in enumerate(bounds)),
        portals=tuple(
            Portal(k, f"portal {k}", (a, b), np.array([segment], dtype=float), 1.0)
            for k, (a, b, segment) in enumerate(portals)
        ),
        exits=tuple(
            Exit(k, f"exit {k}", level, np.array([segment], dtype=float), 1.0)
            for k, (level, segment) in enumerate(exits)
        ),
        areas=(),
        walls=walls,
        wall_level=np.zeros(len(walls), np.int32) if wall_level is None else np.array(wall_level, np.int32),
        stairs={},
    )


def uniform_fields(levels=1, *directions, extent=20.0):
    """The same direction everywhere, +x unless told, one for each route; the travel time falls along it."""
    return one_direction((-extent, -extent, extent, extent), *directions, levels=levels)


def make_engine(crowd, building=None, fields=None, forces=(), full=False):
    building = building or make_building()
    fields = fields or uniform_fields(len(building.levels))
    return CompiledEngine(make_world(building, fields), len(crowd.level), list(forces), full, solvers=SOLVERS)


def walk(model, crowd, steps, h=0.01, engine=None, explicit=True, report=False, tick=10, **scene):
    """Make `steps` steps in ticks of `tick` steps; returns the engine."""
    engine = engine or make_engine(crowd, **scene)
    for first in range(0, steps, tick):
        engine.advance(model, crowd, first, min(tick, steps - first), h, explicit, report)
    return engine


def fields_towards(point, levels=1, extent=12.0, spacing=0.5):
    """Directions that converge on a point, the same for all levels; the travel time is the distance."""
    return towards((-extent, -extent, extent, extent), point, spacing, levels)


def cut_wall(x1, y1, x2, y2, pieces):
    """Return a wall as so many equal pieces, in order."""
    share = np.linspace(0.0, 1.0, pieces + 1)
    x, y = x1 + share * (x2 - x1), y1 + share * (y2 - y1)
    return [tuple(piece) for piece in np.column_stack([x[:-1], y[:-1], x[1:], y[1:]])]


def random_crowd(number, low, high, seed=1, gap=0.0, **settings):
    """People of various sizes at random places of a rectangle, at least `gap` apart; settings as `make_crowd`."""
    random = np.random.default_rng(seed)
    radius = random.uniform(0.18, 0.25, number)
    places, placed = np.zeros((number, 2)), 0
    while placed < number:
        own = radius[placed]
        place = random.uniform(np.array(low) + own, np.array(high) - own)
        if (np.hypot(*(place - places[:placed]).T) > own + radius[:placed] + gap).all():
            places[placed], placed = place, placed + 1
    given = {
        "radius": radius,
        "mass": random.uniform(50.0, 100.0, number),
        "tau": random.uniform(0.1, 0.5, number),
        "speed": random.uniform(1.2, 2.0, number),
    }
    return make_crowd(places, **(given | settings))


def precise_models():
    """One of each model that is to agree to rounding: solved as far as it goes."""
    solved = {"velocity_tolerance": 1e-14, "iterations": 20000}
    return [
        Dem(),
        Nsm1(gap_tolerance=1e-12, **solved),
        Nsm1(variant="overdamped", gap_tolerance=1e-12, **solved),
        Nsm2(**solved),
        Nsm2(normal_dissipation=0.0, **solved),
    ]


def name_of(model):
    """Return an identifier for parametrised tests."""
    if model.name == "nsm1":
        return f"nsm1-{model.variant}"
    if model.name == "nsm2":
        return f"nsm2-{model.normal_dissipation:g}"
    return model.name


def kinetic_energy(crowd):
    return float(0.5 * (crowd.mass * (crowd.velocity**2).sum(axis=1)).sum())
