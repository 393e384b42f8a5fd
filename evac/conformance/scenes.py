"""Scenes for contact models: a flat level, with or without the walls of a room, and one direction for all people."""

from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from shapely.geometry import box

from evac.base.arrays import FloatArray
from evac.building.model.building import Building, Level
from evac.contract.registry import Registry
from evac.directions.fields import NO_CELL_WALLS, Fields, PackedFields
from evac.directions.routes import Route
from evac.physics.contact.model import ContactModel, SolvedContactModel, border_scene
from evac.physics.engine import CompiledEngine
from evac.physics.state import Crowd, make_crowd
from evac.physics.world import make_world

#: Step [s], of which a tick has ten; half the sides of the square room and of the level [m].
STEP, ROOM, EXTENT = 0.01, 2.5, 20.0

EAST, NORTH, NOWHERE = np.array([1.0, 0.0]), np.array([0.0, 1.0]), np.zeros((0, 4))


class Pace(NamedTuple):
    """Time scale and step of a scene, so that checks do not depend on the stiffness of a model.

    Motion is slowed down `slow` times: contacts that are softer by its square have the same overlaps. Each step has a
    number of `parts`.
    """

    slow: int = 1
    parts: int = 1

    @property
    def step(self) -> float:
        """Length of a step [s]."""
        return STEP * self.slow / self.parts

    def __str__(self) -> str:
        slower = f", motion slowed down {self.slow} times" if self.slow > 1 else ""
        return f"steps of {self.step:g} s{slower}"


PLAIN = Pace()


@cache
def registered() -> Registry:
    """Return the registered plugins, read once; the plugin that is checked is not among them."""
    return Registry()


def walk(
    model: ContactModel,
    pace: Pace,
    crowd: Crowd,
    steps: int,
    walls: FloatArray = NOWHERE,
    ahead: FloatArray = EAST,
    saved: Mapping[str, NDArray[Any]] | None = None,
) -> tuple[list[Crowd], CompiledEngine]:
    """Make a number of plain steps in which all people want to walk in one direction; with none, two at the pace.

    Returns copies of the crowd after each tick, with the velocities of the plain pace, and the engine with its report.
    The engine goes on from the snapshot of another one, if it is given.
    """
    world = make_world(_flat(walls), _fields(ahead))
    engine = CompiledEngine(world, len(crowd.level), [], solvers=registered().solvers)
    crowd = crowd.replace(velocity=crowd.velocity / pace.slow, speed=crowd.speed / pace.slow, tau=crowd.tau * pace.slow)
    model.check_scene(border_scene(crowd, pace.step, True))
    if saved is not None:
        engine.load(model)
        engine.restore(saved)
    total, tick, crowds = *((steps * pace.parts, 10 * pace.parts) if steps else (2, 1)), []
    for first in range(0, total, tick):
        engine.advance(model, crowd, first, tick, pace.step, True, True)
        copies = {key: array.copy() for key, array in crowd.values().items()}
        crowds.append(Crowd(**copies | {"velocity": crowd.velocity * pace.slow}))
    return crowds, engine


def room(shift: float = 0.0) -> FloatArray:
    """Return the walls of a closed square room."""
    corners = ROOM * np.array([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)]) + shift
    return np.hstack([corners, np.roll(corners, -1, axis=0)])


def nine_people(turn: bool = False, shift: float = 0.0) -> Crowd:
    """Return nine people of different sizes near the eastern wall, or the northern one if the scene is rotated."""
    k = np.arange(9)
    place = np.column_stack([0.2 + k % 3 * 0.6 + 0.07 * k, k // 3 * 0.55 - 0.6 + 0.05 * (k % 3)])
    sizes = {"radius": np.linspace(0.25, 0.18, 9), "mass": np.linspace(60.0, 100.0, 9)}
    return make_crowd((turned(place) if turn else place) + shift, speed=np.linspace(1.2, 2.0, 9), tau=0.3, **sizes)


def turned(places: FloatArray) -> FloatArray:
    """Return positions rotated by 90 degrees about the origin."""
    return np.column_stack([-places[:, 1], places[:, 0]])


def greatest_overlap(crowd: Crowd) -> float:
    """Return the largest overlap of people with each other and with the walls of the room [m], at least 0."""
    first, second = np.triu_indices(len(crowd.radius), 1)
    apart = np.hypot(*(crowd.position[first] - crowd.position[second]).T)
    between = crowd.radius[first] + crowd.radius[second] - apart
    beyond = np.abs(crowd.position).max(axis=1) + crowd.radius - ROOM
    return float(max(0.0, between.max(), beyond.max()))


def solved_model() -> type[ContactModel]:
    """Return a registered contact model that solves contact problems."""
    return next(model for model in registered().contact_models.values() if issubclass(model, SolvedContactModel))


def _flat(walls: FloatArray) -> Building:
    """Return a building with one flat level and walls on it."""
    ground, none = box(-EXTENT, -EXTENT, EXTENT, EXTENT), np.zeros((0, 3))
    level = Level(0, "floor", "floor", None, none.astype(np.int32), ground, np.zeros(2), 0.0, 0.0, 0.0)
    indices = np.zeros(len(walls), np.int32)
    return Building(Path("conformance"), none, (level,), (), (), (), walls, indices, stairs={})


def _fields(ahead: FloatArray) -> Fields:
    """Return fields with one direction, along which the travel time decreases."""
    packed = PackedFields(
        origin=np.full((1, 2), -EXTENT),
        shape=np.full((1, 2), 2, np.int32),
        spacing=2.0 * EXTENT,
        width=np.zeros(0),
        field_of=np.zeros((1, 1), np.int32),
        offset=np.zeros(1, np.int64),
        direction=np.tile(ahead, (4, 1)),
        travel_time=100.0 - EXTENT * np.array([(-1, -1), (-1, 1), (1, -1), (1, 1)]) @ ahead,
        walls=NO_CELL_WALLS,
    )
    return Fields(routes=(Route(),), packed=packed)
