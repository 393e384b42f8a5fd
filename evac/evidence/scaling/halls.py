"""Halls for the scaling: a hall with walls and doors, its directions, and a crowd with a given density."""

import math
from typing import NamedTuple

import numpy as np

from evac.base.arrays import FloatArray, IndexArray
from evac.base.distributions import generator_for
from evac.building.model.building import Building
from evac.directions.build import build_fields
from evac.directions.fields import Fields
from evac.directions.routes import Route
from evac.evidence.evidence import Row
from evac.physics.scenes import room
from evac.physics.state import Crowd, make_crowd

#: Bodies fit a hexagonal lattice of 5 per m2, 0.48 m apart [m].
RADIUS = (0.2, 0.24)
MASS, TAU, SPEED = (60.0, 100.0), (0.1, 0.5), (1.2, 2.0)  # kg, s, m/s

#: Of a hall that is simulated as a case [people per m2].
DENSITY = 2.0

#: One door of this width in every stretch of this length of the right wall [m].
DOOR, STRETCH = 1.2, 10.0

#: Spacing of the direction grid [m]; coarser where the hall is larger than `LARGE` [m].
SPACING, COARSE, LARGE = 0.1, 0.25, 100.0


class Hall(NamedTuple):
    """A hall and the people in it, before the first step."""

    building: Building
    fields: Fields
    crowd: Crowd
    depth: float  # away from the wall with the doors [m]
    length: float  # of that wall [m]


def make_hall(people: int, density: float, seed: int, deepest: float = math.inf) -> Hall:
    """Return a hall with `people` at `density` per m2, on a jittered hexagonal lattice, without overlaps.

    It is square, or if that would be deeper than `deepest` [m], as deep as that and longer.
    """
    pitch = math.sqrt(2.0 / (math.sqrt(3.0) * density))
    position, depth, length = _lattice(people, pitch, deepest)
    generator = generator_for(seed, "hall", str(people), str(density))
    slack = 0.5 * pitch - RADIUS[1]
    angle = generator.uniform(0.0, 2.0 * math.pi, people)
    shift = slack * np.sqrt(generator.uniform(0.0, 1.0, people))
    position += shift[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    doors = zip(*(ends.tolist() for ends in doors_along(length)), strict=True)
    building = room((0.0, 0.0, depth, length), exits=tuple((depth, low, depth, high) for low, high in doors))
    spacing = SPACING if max(depth, length) <= LARGE else COARSE
    fields = build_fields(building, (Route(),), spacing=spacing, clearance=RADIUS[1], speeds=(1.0, 1.0, 1.0))
    return Hall(building, fields, _crowd(position, generator), depth, length)


def hall_case(people: int) -> Row:
    """Return the content of a case: a square hall with `people` at random places, `DENSITY` per m2."""
    side = math.sqrt(people / DENSITY)
    low, high = doors_along(side)
    walls = [[0.0, 0.0], [side, 0.0], [side, side], [0.0, side]]
    exits = [
        {"name": f"door {k}", "storey": "hall", "segment": [[side, start], [side, end]]}
        for k, (start, end) in enumerate(zip(low.tolist(), high.tolist(), strict=True))
    ]
    group = {"name": "people", "number": people, "level": "hall", "radius": {"uniform": list(RADIUS)}}
    group |= {key: {"uniform": list(ends)} for key, ends in (("mass", MASS), ("tau", TAU), ("speed", SPEED))}
    return {
        "title": f"A hall of {people:,} people",
        "building": {"plan": {"storeys": [{"name": "hall", "polygons": [walls]}], "exits": exits}},
        "directions": {"spacing": SPACING if side <= LARGE else COARSE},
        "people": [group],
    }


def doors_along(length: float) -> tuple[FloatArray, FloatArray]:
    """Return where the doors in a wall of a length begin and end [m]."""
    doors = max(1, round(length / STRETCH))
    middle = length * (np.arange(doors) + 0.5) / doors
    return middle - 0.5 * DOOR, middle + 0.5 * DOOR


def nearest_door(length: float, y: FloatArray) -> IndexArray:
    """Return the index of the door (n,) in a wall of a length [m] that is nearest to places along it (n,) [m]."""
    middle = np.mean(doors_along(length), axis=0)
    nearest: IndexArray = np.abs(middle - y[:, None]).argmin(axis=1)
    return nearest


def _lattice(people: int, pitch: float, deepest: float) -> tuple[FloatArray, float, float]:
    square = math.ceil(math.sqrt(people * math.sqrt(0.75)))
    columns = square if (square + 0.5) * pitch <= deepest else int(deepest / pitch - 0.5)
    row, column = np.divmod(np.arange(people), columns)
    x = pitch * (0.5 + column + 0.5 * (row % 2))
    y = pitch * (0.5 + math.sqrt(0.75) * row)
    depth, length = float(x.max()) + 0.5 * pitch, float(y.max()) + 0.5 * pitch
    if columns == square:
        depth = length = max(depth, length)
    return np.stack([x, y], axis=1), depth, length


def _crowd(position: FloatArray, generator: np.random.Generator) -> Crowd:
    n = len(position)
    return make_crowd(
        position,
        radius=generator.uniform(*RADIUS, n),
        mass=generator.uniform(*MASS, n),
        tau=generator.uniform(*TAU, n),
        speed=generator.uniform(*SPEED, n),
    )
