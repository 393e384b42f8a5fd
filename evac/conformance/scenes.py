"""Scenes for contact models: a flat level, with or without the walls of a room, and one direction for all people."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from evac.base.arrays import FloatArray
from evac.evidence import scenes
from evac.evidence.models import make_engine, plugins
from evac.physics.contact.model import ContactModel, SolvedContactModel, border_scene
from evac.physics.engine import CompiledEngine
from evac.physics.state import Crowd, make_crowd
from evac.physics.world import make_world

#: Step [s], of which a tick has ten; half the side of the square room, and the ends of the level around it [m].
STEP, ROOM, LEVEL = 0.01, 2.5, (-20.0, -20.0, 20.0, 20.0)

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
    engine = make_engine(make_world(scenes.room(LEVEL, walls), scenes.one_direction(LEVEL, ahead)), len(crowd.level))
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
    return next(model for model in plugins().contact_models.values() if issubclass(model, SolvedContactModel))
