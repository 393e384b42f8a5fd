"""Checks of contact models in small scenes, at a pace that suits their stiffness."""

import math

import numpy as np

from evac.base.errors import EvacError
from evac.conformance.failures import CheckError, examining, require, scene
from evac.conformance.scenes import EAST, NORTH, PLAIN, ROOM, Pace, greatest_overlap, nine_people, room, turned, walk
from evac.physics.contact.model import ContactModel
from evac.physics.contact.packing import packed_row
from evac.physics.contact.pair_contact import PairContact
from evac.physics.state import Crowd, make_crowd

#: Tolerance of positions after rotating or shifting a scene [m]; the iteration counts of solvers may differ.
TURN_TOLERANCE = 1e-4

#: Sums of the report that may be negative.
SIGNED = ("driving_work", "contact_dissipation", "contact_creation")

PRESSED = "nine people pressed against a wall"

#: Another order of these people.
ANOTHER_ORDER = [4, 7, 0, 2, 8, 5, 1, 6, 3]


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
                require(friction * slide <= 0.0, wrong, "return a force that brakes, with the opposite sign")
        require(np.array_equal(packed, before), "the law changes its parameters", "only return the force")


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
    for title, crowd, steps in (
        ("two people at one place", at_one_place, 0),  # for two steps; later, stiff contacts throw them far
        (PRESSED, nine_people(), 200),
        ("a person pushed towards a wall", thrown, 50),
    ):
        with scene(f"{title}, {pace}"):
            for place in [crowd.position for crowd in walk(model, pace, crowd, steps, room())[0]]:
                beyond = np.abs(place).max(axis=1) - ROOM
                (x, y), far = place[beyond.argmax()], beyond.max()
                wrong = f"a person passed through the wall, at ({x:.2f}, {y:.2f}), {far:.2g} m beyond it"
                require(far <= 0.0, wrong, "apply percussions at walls too, where contacts.other is -1")


def check_free_walk(model: ContactModel, pace: Pace) -> None:
    """Check that a person without contacts moves by eq. 33, bitwise equal alone and with distant people."""
    n, speed, tau = 60, 1.5, 0.5
    with scene(f"a person without contacts, {pace}"):
        alone = walk(model, pace, make_crowd([[0.0, 0.0]], speed=speed, tau=tau), n)[0][-1]
        steps, share = n * pace.parts, pace.step / (pace.slow * tau)
        exact = speed if model.overdamped else speed * (1.0 - (1.0 - share) ** steps)
        wrong = f"walks at {alone.velocity[0, 0]:.9f} m/s after {steps} steps, not at {exact:.9f} m/s"
        remedy = "without contacts, the velocity after a step must be the free velocity"
        require(np.allclose(alone.velocity[0], [exact, 0.0], rtol=0.0, atol=1e-9), wrong, remedy)
    with scene(f"two people 5 m apart, {pace}"):
        two = walk(model, pace, make_crowd([[0.0, 0.0], [0.0, 5.0]], speed=speed, tau=tau), n)[0][-1]
        apart = float(np.abs(alone.position[0] - two.position[0]).max())
        require(apart == 0.0, f"a person 5 m away changes a free walk by {apart:.3g} m", "use only the given contacts")


def check_collision(model: ContactModel, pace: Pace) -> None:
    """Check that two people who collide do not pass through each other, and conserve momentum and energy."""
    if model.overdamped:
        return
    with scene(f"two people who collide, {pace}"):
        velocity = np.array([[1.5, 0.0], [-1.0, 0.0]])
        crowd = make_crowd([[-0.3, 0.0], [0.3, 0.0]], velocity=velocity, mass=[60.0, 100.0], tau=1e12)
        crowds, engine = walk(model, pace, crowd, 40)
        after, mass, report = crowds[-1].velocity, crowd.mass, engine.report()
        lost = float(np.abs(mass @ (after - velocity)).max())
        wrong = f"their total momentum changes by {lost:.3g} kg m/s"
        require(lost <= 1e-6 * pace.slow, wrong, "percussions on both must be opposite and equal")
        remedy = "change the velocities of bodies with a negative gap"
        require(not np.allclose(after, velocity, atol=1e-3), "they walk through each other", remedy)
        gained = 0.5 * float(mass @ (after**2 - velocity**2).sum(axis=1)) / pace.slow**2
        told = report["driving_work"] - report["contact_dissipation"] + report["contact_creation"]
        wrong = f"they gain {gained:.4g} J, but their percussions account for {told:.4g} J"
        remedy = "contacts.percussion must contain the percussions that changed the velocities"
        require(abs(told - gained) <= 1e-6 * (abs(gained) + 1.0), wrong, remedy)


def check_crowd(model: ContactModel, pace: Pace) -> None:
    """Check the report on people pressed against a wall, and that their motion does not depend on coordinates."""
    with scene(f"{PRESSED}, {pace}"):
        crowds, engine = walk(model, pace, nine_people(), 200, room())
        report = engine.report()
        for key, value in report.items():
            is_valid = math.isfinite(value) and (value >= 0.0 or key in SIGNED)
            require(is_valid, f"reports {key} = {value}", "percussions must be finite and not negative")
        counts, steps = [report[key] for key in ("steps", "sub_steps", "contacts")], 200 * pace.parts
        wrong = "reports {:.0f} steps, {:.0f} sub-steps and {:.0f} contacts".format(*counts)
        remedy = "let the step loop of evac.physics.driver make the steps"
        is_right = counts[0] == steps <= counts[1] and counts[2] > 0
        require(is_right, f"{wrong} after {steps} steps", remedy)
        told, seen = report["greatest_overlap"], max(greatest_overlap(crowd) for crowd in crowds[:-1])
        wrong = f"reports a largest overlap of {told:.2g} m, but one of {seen:.2g} m occurred"
        require(told >= seen - 1e-9, wrong, remedy)
    plain = crowds[5].position  # after 60 steps
    for what, turn, shift in (("rotated by 90 degrees", True, 0.0), ("shifted", False, 3.25)):
        with scene(f"{PRESSED}, {what}, {pace}"):
            ahead = NORTH if turn else EAST
            crowds, _ = walk(model, pace, nine_people(turn, shift), 60, room(shift), ahead)
            moved = crowds[-1].position - shift
            apart = float(np.abs(moved - (turned(plain) if turn else plain)).max())
            remedy = "use gaps and normals, not coordinates"
            require(apart <= TURN_TOLERANCE, f"the motion differs by {apart:.3g} m", remedy)


def check_memory(model: ContactModel, pace: Pace) -> None:
    """Check that what contacts remember belongs to persons, whatever their order, and that a snapshot has all of it.

    It must not belong to one of two people, nor to x and y: in a scene that is rotated in the middle, bodies are in
    another order from then on.
    """
    remedy = "keep it in contacts.memory, and components along normal and tangent instead of x and y"
    with scene(f"{PRESSED}, {pace}"):
        crowds, _ = walk(model, pace, nine_people(), 120, room())
    half, whole = crowds[5], crowds[-1].position
    with scene(f"{PRESSED}, in another order, {pace}"):
        mixed = Crowd(**{name: array[ANOTHER_ORDER] for name, array in nine_people().values().items()})
        crowds, engine = walk(model, pace, mixed, 60, room())
        apart = float(np.abs(crowds[-1].position - half.position[ANOTHER_ORDER]).max())
        require(apart <= TURN_TOLERANCE, f"the motion differs by {apart:.3g} m", remedy)
    if not model.memory:
        return
    _, engine = walk(model, pace, nine_people(), 60, room())
    with scene(f"{PRESSED}, resumed in the middle, {pace}"):
        crowd = nine_people().replace(position=half.position.copy(), velocity=half.velocity.copy())
        crowds, _ = walk(model, pace, crowd, 60, room(), saved=engine.snapshot())
        apart = float(np.abs(crowds[-1].position - whole).max())
        require(apart == 0.0, f"the motion differs by {apart:.3g} m", remedy)
    with scene(f"{PRESSED}, rotated in the middle, {pace}"):
        walls = np.hstack([turned(room()[:, :2]), turned(room()[:, 2:])])
        crowd = nine_people().replace(position=turned(half.position), velocity=turned(half.velocity))
        crowds, _ = walk(model, pace, crowd, 60, walls, NORTH, engine.snapshot())
        apart = float(np.abs(crowds[-1].position - turned(whole)).max())
        require(apart <= TURN_TOLERANCE, f"the motion differs by {apart:.3g} m", remedy)


CHECKS = (check_free_walk, check_collision, check_room, check_crowd, check_memory)
