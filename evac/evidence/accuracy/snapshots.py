"""Crowds at a door, arriving or settled against it, reproducible from a seed.

A square room at 3.5 people per m2, 1 m door in the middle of one wall, directions straight to the door. The
crowd walks until it is arriving, or is pressed against the closed door until it has settled.
"""

from dataclasses import dataclass

import numpy as np

from evac.directions.fields import Fields
from evac.evidence.scenes import make_engine, packed
from evac.physics.contact.model import ContactModel
from evac.physics.engine import CompiledEngine
from evac.physics.scenes import fields_of, room
from evac.physics.state import Crowd, copy_of, make_crowd
from evac.physics.world import make_world, set_open

DENSITY = 3.5  # people per m2
DOOR = 1.0  # m
STEP = 0.01  # s

#: Distance of people in rows, of bodies 0.4 m wide [m].
ROW = 0.42


@dataclass
class DoorCrowd:
    """A crowd in a room with a door, ready for its next step."""

    kind: str
    engine: CompiledEngine
    crowd: Crowd
    step: int = 0  # steps made so far

    def copy(self, kind: str = "") -> "DoorCrowd":
        """Return an independent copy, with its own door and a new engine."""
        world, crowd = self.engine.state.world, copy_of(self.crowd)
        own = world.replace(wall_open=world.wall_open.copy(), link_open=world.link_open.copy())
        return DoorCrowd(kind or self.kind, make_engine(own, len(crowd.level)), crowd, self.step)

    def open_door(self, is_open: bool) -> None:
        """Open or close the door."""
        set_open(self.engine.state.world, 0, is_open)

    def walk(self, model: ContactModel, steps: int, step: float = STEP) -> None:
        """Make `steps` steps of `step` [s] in one tick."""
        self.engine.advance(model, self.crowd, self.step, steps, step, False, False)
        self.step += steps


def standing_crowd(kind: str, people: int, seed: int) -> DoorCrowd:
    """Return a crowd before its first step: of a kind of `door_crowd`, whose door is open for ``"arriving"`` alone."""
    side = float(np.sqrt(people / DENSITY))
    generator = np.random.default_rng(np.random.SeedSequence([seed, people]))
    crowd = _rows(people, side) if kind == "in rows" else _crowd(people, side, generator)
    low, high = 0.5 * (side - DOOR), 0.5 * (side + DOOR)
    door_room = room((0.0, 0.0, side, side), exits=((side, low, side, high),))
    found = DoorCrowd(kind, make_engine(make_world(door_room, door_fields(side)), people), crowd)
    found.open_door(kind == "arriving")
    return found


def door_crowd(kind: str, people: int, seed: int, model: ContactModel) -> DoorCrowd:
    """Walk a crowd to a door by a contact model; NSM1 leaves no overlaps.

    Kinds are ``"arriving"``: half-way through the time that the crowd needs to pack at the door; ``"settled"``: pressed
    against the closed door for twice that time; ``"in rows"``: equal people who stood in rows before the closed door, 2
    cm apart, and have walked towards it for two seconds, so that the rows close up.
    """
    crowd = standing_crowd(kind, people, seed)
    packing = 0.35 * float(np.sqrt(people / DENSITY)) / 1.3
    seconds = {"arriving": packing, "settled": 2.0 * packing + 2.0, "in rows": 2.0}[kind]
    for _ in range(int(np.ceil(10.0 * seconds))):
        crowd.walk(model, 10)
    return crowd


def door_fields(side: float) -> Fields:
    """Return the field that points straight to the door, shrunk by 0.25 m at its posts."""
    spacing = 0.1
    axis = np.arange(-2, int(side / spacing) + 5) * spacing
    x, y = np.meshgrid(axis, axis, indexing="ij")
    across = np.clip(y, 0.5 * (side - DOOR) + 0.25, 0.5 * (side + DOOR) - 0.25) - y
    ahead = np.maximum(side - x, 0.0) + 0.05
    distance = np.hypot(ahead, across)
    direction = np.stack([ahead / distance, across / distance], axis=-1).reshape(-1, 2)
    return fields_of((axis[0], axis[0]), (len(axis), len(axis)), spacing, direction, distance.ravel())


def _crowd(people: int, side: float, generator: np.random.Generator) -> Crowd:
    columns = int(np.ceil(np.sqrt(people)))
    pitch = side / columns
    cell = np.arange(people)
    centre = pitch * (np.stack([cell // columns, cell % columns], axis=1) + 0.5)
    slack = max(0.0, 0.5 * pitch - 0.25)
    speed = generator.uniform(1.5, 2.0, people)
    return make_crowd(
        centre + generator.uniform(-slack, slack, (people, 2)),
        radius=generator.uniform(0.2, 0.25, people),
        mass=generator.uniform(60.0, 100.0, people),
        tau=generator.uniform(0.1, 0.5, people),
        speed=speed,
    )


def _rows(people: int, side: float) -> Crowd:
    rows = int((side - 0.5 * ROW - 0.02) / ROW)
    return make_crowd(packed(people, rows, 0.2, side - 0.02, 0.02, ROW - 0.4), speed=1.5)
