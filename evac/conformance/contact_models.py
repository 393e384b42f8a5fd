"""Checks of contact models on a flat level, with or without walls, at a pace that suits their stiffness."""

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from evac.base.arrays import FloatArray
from evac.base.errors import EvacError
from evac.conformance.failures import CheckError, examining, require, require_close, scene
from evac.conformance.scenes import Scene, one_direction, room
from evac.physics.contact.model import ContactModel, border_scene
from evac.physics.contact.packing import packed_row
from evac.physics.contact.pair_contact import PairContact
from evac.physics.engine import CompiledEngine
from evac.physics.state import Crowd, copy_of, make_crowd

#: Step [s], of which a tick has ten; half the side of the square room, and the ends of the level around it [m].
STEP, ROOM, LEVEL = 0.01, 2.5, (-20.0, -20.0, 20.0, 20.0)

EAST, NORTH, NOWHERE = np.array([1.0, 0.0]), np.array([0.0, 1.0]), np.zeros((0, 4))

#: Walls of the closed square room.
WALLS = ROOM * np.array(
    [(-1.0, -1.0, 1.0, -1.0), (1.0, -1.0, 1.0, 1.0), (1.0, 1.0, -1.0, 1.0), (-1.0, 1.0, -1.0, -1.0)]
)

#: Tolerance of positions after rotating or shifting a scene [m]; the iteration counts of solvers may differ.
TURN_TOLERANCE = 1e-4

#: Sums of the report that may be negative.
SIGNED = ("driving_work", "contact_dissipation", "contact_creation")

#: A scene, its people in steps of a grid near the eastern wall, and another order of them.
PRESSED, NINE, ANOTHER_ORDER = "nine people pressed against a wall", np.arange(9), [4, 7, 0, 2, 8, 5, 1, 6, 3]
NINE_PEOPLE = make_crowd(
    np.column_stack([0.2 + NINE % 3 * 0.6 + 0.07 * NINE, NINE // 3 * 0.55 - 0.6 + 0.05 * (NINE % 3)]),
    radius=np.linspace(0.25, 0.18, 9),
    mass=np.linspace(60.0, 100.0, 9),
    speed=np.linspace(1.2, 2.0, 9),
    tau=0.3,
)


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
    slowed = {"velocity": crowd.velocity / pace.slow, "speed": crowd.speed / pace.slow, "tau": crowd.tau * pace.slow}
    given = Scene(LEVEL, room(LEVEL, walls), one_direction(LEVEL, ahead), crowd.replace(**slowed))
    engine, crowd = given.start()
    model.check_scene(border_scene(crowd, pace.step, True))
    if saved is not None:
        engine.load(model)
        engine.restore(saved)
    total, tick, crowds = *((steps * pace.parts, 10 * pace.parts) if steps else (2, 1)), []
    for first in range(0, total, tick):
        engine.advance(model, crowd, first, tick, pace.step, True, True)
        crowds.append(copy_of(crowd).replace(velocity=crowd.velocity * pace.slow))
    return crowds, engine


def check_pair_law(model: PairContact) -> None:
    """Check that the law of a single contact is finite and brakes sliding where bodies touch, without side effects."""
    with examining("its function pair"):
        model.check_pair()
        packed = packed_row(model, f"contact model {model.name!r}")
    with scene("two people of 80 kg who touch or overlap"):
        before = packed.copy()
        for gap, closing in ((0.0, 2.0), (-1e-9, -2.0), (-0.2, 0.0)):
            for slide in (-1.0, 1.0):
                friction = model.forces(gap, closing, 40.0, packed, slide, 0.01)[1]
                wrong = f"the friction is {friction:.3g} N for the sliding speed {slide} m/s"
                require(friction * slide <= 0.0, f"{wrong}; return a force that brakes, with the opposite sign")
        require(np.array_equal(packed, before), "the law changes its parameters; only return the force")


def check_pace(model: ContactModel) -> Pace:
    """Return the pace at which `check_room` passes: the plain one, slower motion, or shorter steps.

    If all fail, the cause is not the stiffness, and the plain pace is returned, at which other checks fail. An
    exception of the plugin, other than an arithmetic one, fails at once.
    """
    for pace in [PLAIN, *(pace for k in (8, 64, 512) for pace in (Pace(k, k), Pace(1, k)))]:
        try:
            check_room(model, pace)
        except CheckError as error:
            if not isinstance(error.__cause__, EvacError | ArithmeticError | None):
                raise
        else:
            return pace
    return PLAIN


def check_room(model: ContactModel, pace: Pace) -> None:
    """Check that people at one place, pressed or thrown against a wall stay in the room."""
    at_one_place = make_crowd([[0.0, 0.0], [0.0, 0.0], [ROOM, 0.0]], speed=1.0)
    thrown = make_crowd([[2.0, 0.0]], velocity=[[10.0, 0.0]], speed=2.0, tau=0.1)
    for title, people, steps in (
        ("two people at one place", at_one_place, 0),  # for two steps; later, stiff contacts throw them far
        (PRESSED, NINE_PEOPLE, 200),
        ("a person pushed towards a wall", thrown, 50),
    ):
        with scene(f"{title}, {pace}"):
            for crowd in walk(model, pace, people, steps, WALLS)[0]:
                beyond = np.abs(crowd.position).max(axis=1) - ROOM
                (x, y), far = crowd.position[beyond.argmax()], beyond.max()
                wrong = f"a person passed through the wall, at ({x:.2f}, {y:.2f}), {far:.2g} m beyond it"
                require(far <= 0.0, f"{wrong}; apply percussions at walls too, where contacts.other is -1")


def check_free_walk(model: ContactModel, pace: Pace) -> None:
    """Check that a person without contacts moves by eq. 33, bitwise equal alone and with distant people."""
    steps, speed, tau = 60 * pace.parts, 1.5, 0.5
    with scene(f"a person without contacts, {pace}"):
        alone = walk(model, pace, make_crowd([[0.0, 0.0]], speed=speed, tau=tau), 60)[0][-1]
        exact = speed if model.overdamped else speed * (1.0 - (1.0 - pace.step / (pace.slow * tau)) ** steps)
        wrong = f"walks at {alone.velocity[0, 0]:.9f} m/s after {steps} steps, not at {exact:.9f} m/s"
        remedy = "without contacts, the velocity after a step must be the free velocity"
        require_close(alone.velocity[0], [exact, 0.0], 1e-9, f"{wrong}; {remedy}")
    with scene(f"two people 5 m apart, {pace}"):
        two = walk(model, pace, make_crowd([[0.0, 0.0], [0.0, 5.0]], speed=speed, tau=tau), 60)[0][-1]
        told = "a person 5 m away changes a free walk by {:.3g} m; use only the given contacts"
        require_close(alone.position[0], two.position[0], 0.0, told)


def check_collision(model: ContactModel, pace: Pace) -> None:
    """Check that two people who collide do not pass through each other, and conserve momentum and energy."""
    if model.overdamped:
        return
    with scene(f"two people who collide, {pace}"):
        velocity, mass = np.array([[1.5, 0.0], [-1.0, 0.0]]), np.array([60.0, 100.0])
        crowd = make_crowd([[-0.3, 0.0], [0.3, 0.0]], velocity=velocity, mass=mass, tau=1e12)
        crowds, engine = walk(model, pace, crowd, 40)
        after, report = crowds[-1].velocity, engine.report()
        told = "their total momentum changes by {:.3g} kg m/s; percussions on both must be opposite and equal"
        require_close(mass @ after, mass @ velocity, 1e-6 * pace.slow, told)
        told = "they walk through each other; change the velocities of bodies with a negative gap"
        require(not np.allclose(after, velocity, atol=1e-3), told)
        gained = 0.5 * float(mass @ (after**2 - velocity**2).sum(axis=1)) / pace.slow**2
        stated = report["driving_work"] - report["contact_dissipation"] + report["contact_creation"]
        wrong = f"they gain {gained:.4g} J, but their percussions account for {stated:.4g} J"
        told = f"{wrong}; contacts.percussion must contain the percussions that changed the velocities"
        require_close(stated, gained, 1e-6 * (abs(gained) + 1.0), told)


def check_crowd(model: ContactModel, pace: Pace) -> None:
    """Check the report on people pressed against a wall; coordinates and order do not matter, nor who remembers.

    What contacts remember must be in the snapshot, and belong neither to one of two people, nor to x and y: in a scene
    that is rotated in the middle, bodies are in another order from then on.
    """
    with scene(f"{PRESSED}, {pace}"):
        crowds, engine = walk(model, pace, NINE_PEOPLE, 200, WALLS)
        report = engine.report()
        for key, value in report.items():
            is_valid = math.isfinite(value) and (value >= 0.0 or key in SIGNED)
            require(is_valid, f"reports {key} = {value}; percussions must be finite and not negative")
        counts, steps = [report[key] for key in ("steps", "sub_steps", "contacts")], 200 * pace.parts
        remedy = "let the step loop of evac.physics.driver make the steps"
        wrong = "reports {:.0f} steps, {:.0f} sub-steps and {:.0f} contacts".format(*counts)
        require(counts[0] == steps <= counts[1] and counts[2] > 0, f"{wrong} after {steps} steps; {remedy}")
        told, seen = report["greatest_overlap"], max(_deepest_overlap(one) for one in crowds[:-1])
        wrong = f"reports a largest overlap of {told:.2g} m, but one of {seen:.2g} m occurred"
        require(told >= seen - 1e-9, f"{wrong}; {remedy}")
    half, whole, shift = crowds[5], crowds[11].position, 3.25  # after 60 and 120 steps
    shifted = NINE_PEOPLE.replace(position=NINE_PEOPLE.position + shift)
    mixed = Crowd(**{name: array[ANOTHER_ORDER] for name, array in NINE_PEOPLE.values().items()})
    gaps = "use gaps and normals, not coordinates"
    memory = "keep it in contacts.memory, and components along normal and tangent instead of x and y"
    parts: list[tuple[str, Crowd, Any, FloatArray, str]] = [
        ("rotated by 90 degrees", _turned_people(NINE_PEOPLE), (WALLS, NORTH), _turned(half.position), gaps),
        ("shifted", shifted, (WALLS + shift, EAST), half.position + shift, gaps),
        ("in another order", mixed, (WALLS, EAST), half.position[ANOTHER_ORDER], memory),
    ]
    if model.memory:
        saved = walk(model, pace, NINE_PEOPLE, 60, WALLS)[1].snapshot()
        later = NINE_PEOPLE.replace(position=half.position, velocity=half.velocity)
        parts += [
            ("resumed in the middle", later, (WALLS, EAST, saved), whole, memory),
            ("rotated in the middle", _turned_people(later), (_turned(WALLS), NORTH, saved), _turned(whole), memory),
        ]
    for what, people, given, expected, remedy in parts:
        with scene(f"{PRESSED}, {what}, {pace}"):
            place = walk(model, pace, people, 60, *given)[0][-1].position
            tolerance = 0.0 if what.startswith("resumed") else TURN_TOLERANCE
            require_close(place, expected, tolerance, f"the motion differs by {{:.3g}} m; {remedy}")


def _deepest_overlap(crowd: Crowd) -> float:
    """Return the greatest overlap [m] of people in the square room with each other and with its walls."""
    first, second = np.triu_indices(len(crowd.position), 1)
    apart = np.hypot(*(crowd.position[first] - crowd.position[second]).T)
    overlaps = crowd.radius[first] + crowd.radius[second] - apart
    return float(max(0.0, overlaps.max(), (np.abs(crowd.position).max(axis=1) + crowd.radius - ROOM).max()))


def _turned(places: FloatArray) -> FloatArray:
    """Return positions (n, 2) or segments (n, 4) rotated by 90 degrees about the origin."""
    return np.stack([-places[:, 1::2], places[:, ::2]], axis=2).reshape(places.shape)


def _turned_people(crowd: Crowd) -> Crowd:
    return crowd.replace(position=_turned(crowd.position), velocity=_turned(crowd.velocity))


CHECKS = (check_free_walk, check_collision, check_room, check_crowd)
