"""Artificial scenes: one flat level with or without walls, on which all people want to walk in one direction."""

from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from shapely.geometry import box

from evac.base.arrays import FloatArray
from evac.base.errors import PluginError, ScenarioError, SimulationError
from evac.building.model.building import Building, Level
from evac.conformance.failures import CheckError, scene
from evac.contract.registry import Registry
from evac.directions.fields import NO_CELL_WALLS, Fields, PackedFields
from evac.directions.routes import Route
from evac.physics.contact.model import ContactModel, border_scene
from evac.physics.engine import CompiledEngine
from evac.physics.state import Crowd, make_crowd
from evac.physics.world import make_world

#: Step of the scenes [s]; a tick is ten steps. For stiff models they are divided, see `Pace`.
STEP = 0.01

#: Half the side of the square room that people are pressed into [m].
ROOM = 2.5

#: Half the side of the level [m].
EXTENT = 20.0


class Pace(NamedTuple):
    """Time scale and step of a scene, so that checks do not depend on the stiffness of a model.

    Attributes
    ----------
    slow : int
        Factor by which all motion is slowed down. Contacts that are softer by its square have the same overlaps.
    parts : int
        Number of parts of each step.
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


#: Names of the scenes below.
COINCIDENT, THROWN = "two people at one place", "a person pushed towards a wall"
PRESSED = "nine people pressed against a wall"

#: Remedy for people who pass through a wall.
WALLS = "apply percussions at walls too, where contacts.other is -1"


def check_pace(model: ContactModel) -> Pace:
    """Return the pace at which a model separates coincident people, and keeps people pressed against a wall inside.

    The plain pace is tried first, then slower motion (for soft contacts) and shorter steps (for stiff ones). If all
    fail, the cause is not the stiffness, and the plain pace is returned, at which other checks fail. An exception of
    the plugin, other than an arithmetic one, fails at once.
    """
    powers = [8**k for k in range(1, 4)]
    for pace in [PLAIN, *(pace for k in powers for pace in (Pace(k, k), Pace(1, k)))]:
        if all(_stays_inside(model, title, pace) for title in (COINCIDENT, PRESSED, THROWN)):
            return pace
    return PLAIN


def _stays_inside(model: ContactModel, title: str, pace: Pace) -> bool:
    """Return whether a scene can be simulated at a pace, and everybody remains in the room."""
    with scene(f"{title}, {pace}"):
        try:
            if title == COINCIDENT:
                coincident(model, pace)
            elif title == PRESSED:
                pressed(model, 200, watch=refuse_outside, pace=pace)
            else:
                refuse_outside(thrown(model, pace)[0])
            return True
        except (PluginError, ScenarioError, SimulationError) as error:
            if error.__cause__ is None or isinstance(error.__cause__, ArithmeticError):
                return False
            raise


def refuse_outside(crowd: Crowd) -> None:
    """Check that everybody is in the room."""
    outside = np.flatnonzero(np.abs(crowd.position).max(axis=1) > ROOM)
    if len(outside):
        x, y = crowd.position[outside[0]]
        beyond = max(abs(x), abs(y)) - ROOM
        raise CheckError(f"a person passed through the wall, at ({x:.2f}, {y:.2f}), {beyond:.2g} m beyond it", WALLS)


def coincident(model: ContactModel, pace: Pace) -> Crowd:
    """Place two people at one position and one on a wall, and make two steps; later, stiff contacts throw them far."""
    crowd = make_crowd([[0.0, 0.0], [0.0, 0.0], [ROOM, 0.0]], speed=1.0)
    return walked(model, crowd, 0, room(), pace=pace)[0]


def thrown(model: ContactModel, pace: Pace) -> tuple[Crowd, CompiledEngine]:
    """Let a person hit a wall of a closed room at high speed."""
    return walked(model, make_crowd([[2.0, 0.0]], velocity=[[10.0, 0.0]], speed=2.0, tau=0.1), 50, room(), pace=pace)


def room() -> list[tuple[float, float, float, float]]:
    """Return the walls of a closed square room around the origin."""
    corners = [(-ROOM, -ROOM), (ROOM, -ROOM), (ROOM, ROOM), (-ROOM, ROOM)]
    return [(*corner, *corners[(k + 1) % 4]) for k, corner in enumerate(corners)]


def pressed(
    model: ContactModel,
    steps: int,
    turn: bool = False,
    shift: float = 0.0,
    watch: Callable[[Crowd], None] = lambda crowd: None,
    pace: Pace = PLAIN,
) -> tuple[Crowd, CompiledEngine]:
    """Press nine people of different sizes against a wall of a closed room; the scene may be rotated and shifted."""
    spread = np.array([[(k % 3) * 0.6 + 0.07 * k, (k // 3) * 0.55 - 0.6 + 0.05 * (k % 3)] for k in range(9)])
    position, walls = spread + np.array([0.2, 0.0]), np.array(room())
    if turn:
        position = np.column_stack([-position[:, 1], position[:, 0]])
        walls = np.column_stack([-walls[:, 1], walls[:, 0], -walls[:, 3], walls[:, 2]])
    crowd = make_crowd(
        position + shift,
        speed=np.linspace(1.2, 2.0, 9),
        radius=np.linspace(0.25, 0.18, 9),
        mass=np.linspace(60.0, 100.0, 9),
        tau=0.3,
    )
    return walked(model, crowd, steps, walls + shift, (0.0, 1.0) if turn else (1.0, 0.0), watch, pace)


def greatest_overlap(crowd: Crowd) -> float:
    """Return the largest overlap of people with each other and with the walls of the room [m], at least 0."""
    first, second = np.triu_indices(len(crowd.radius), 1)
    apart = np.hypot(*(crowd.position[first] - crowd.position[second]).T)
    between = crowd.radius[first] + crowd.radius[second] - apart
    outside = np.abs(crowd.position).max(axis=1) + crowd.radius - ROOM
    return max(0.0, float(between.max()), float(outside.max()))


def walked(
    model: ContactModel,
    crowd: Crowd,
    steps: int,
    walls: Any = (),
    direction: tuple[float, float] = (1.0, 0.0),
    watch: Callable[[Crowd], None] = lambda crowd: None,
    pace: Pace = PLAIN,
) -> tuple[Crowd, CompiledEngine]:
    """Make a number of steps in which all people want to walk in one direction; call `watch` after each tick.

    Velocities, speeds and relaxation times of the crowd are those of the plain pace, before and after. With no steps,
    the first two steps at the pace are made.

    Raises
    ------
    SimulationError
        A step cannot be made.
    ScenarioError
        The model refuses the scene.
    """
    building = _flat(np.array(walls, dtype=np.float64).reshape(-1, 4))
    engine = CompiledEngine(
        make_world(building, _fields(np.array(direction))), len(crowd.level), [], solvers=Registry().solvers
    )
    _slow_down(crowd, pace.slow)
    model.check_scene(border_scene(crowd, pace.step, True))
    total, tick = (steps * pace.parts, 10 * pace.parts) if steps else (2, 1)
    for first in range(0, total, tick):
        engine.advance(model, crowd, first, tick, pace.step, True, True)
        watch(crowd)
    _slow_down(crowd, 1.0 / pace.slow)
    return crowd, engine


def _slow_down(crowd: Crowd, times: float) -> None:
    crowd.velocity /= times
    crowd.speed /= times
    crowd.tau *= times


def _flat(walls: FloatArray) -> Building:
    """Return a building with one flat level and walls on it."""
    level = Level(
        index=0,
        name="floor",
        kind="floor",
        stair=None,
        triangles=np.zeros((0, 3), np.int32),
        polygon=box(-EXTENT, -EXTENT, EXTENT, EXTENT),
        uphill=np.zeros(2),
        slope=0.0,
        z_min=0.0,
        z_max=0.0,
    )
    return Building(
        source=Path("conformance"),
        vertices=np.zeros((0, 3)),
        levels=(level,),
        portals=(),
        exits=(),
        areas=(),
        walls=walls,
        wall_level=np.zeros(len(walls), np.int32),
        stairs={},
    )


def _fields(direction: FloatArray) -> Fields:
    """Return fields with a uniform direction, along which the travel time decreases."""
    nodes = EXTENT * np.array([[-1.0, -1.0], [-1.0, 1.0], [1.0, -1.0], [1.0, 1.0]])
    return Fields(
        routes=(Route(),),
        packed=PackedFields(
            origin=np.full((1, 2), -EXTENT),
            shape=np.full((1, 2), 2, np.int32),
            spacing=2.0 * EXTENT,
            width=np.zeros(0),
            field_of=np.zeros((1, 1), np.int32),
            offset=np.zeros(1, np.int64),
            direction=np.tile(direction, (4, 1)),
            travel_time=100.0 - nodes @ direction,
            walls=NO_CELL_WALLS,
        ),
    )
