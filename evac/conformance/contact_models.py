"""Checks of contact models in small artificial scenes, at a pace that suits their stiffness."""

import math
from collections.abc import Callable

import numpy as np

from evac.conformance.scenes import ROOM, Pace, coincident, greatest_overlap, pressed, thrown, walked
from evac.errors import PluginError
from evac.jit import call_pair_contact
from evac.physics.contact_model import ContactModel
from evac.physics.pair_contact import PairContact
from evac.physics.state import make_crowd

#: Tolerance of positions after rotating or shifting a scene [m]; the iteration counts of solvers may differ.
TURN_TOLERANCE = 1e-4

#: Sums of the report that may be negative.
SIGNED = ("driving_work", "contact_dissipation", "contact_creation")


def check_pair_law(model: ContactModel, pace: Pace) -> None:
    """Check that the law of a single contact is finite and repulsive, and has no side effects."""
    if not isinstance(model, PairContact):
        return
    call_pair_contact.check(model.pair, f"{model.name}: pair")
    packed = model.packed()
    if packed.dtype != np.float64 or packed.ndim != 1 or not np.isfinite(packed).all():
        raise PluginError(f"packed() must return finite numbers in one float64 row, not {packed!r}")
    before, greatest = packed.copy(), 0.0
    for overlap in (0.0, 1e-9, 1e-3, 0.05, 0.2, 0.4):
        for closing in (-2.0, 0.0, 2.0):
            scene = f"two people of 80 kg, overlap {overlap} m, closing speed {closing} m/s"
            try:
                with np.errstate(all="ignore"):
                    force = float(model.pair.function(-overlap, closing, 40.0, packed))
            except ArithmeticError as error:
                raise PluginError(f"{scene}: {error}; the force must be finite there") from error
            if not math.isfinite(force):
                raise PluginError(f"{scene}: the force is {force} N; it must be finite there")
            greatest = max(greatest, force)
    if not greatest > 0.0:
        raise PluginError("two people of 80 kg: the force is never positive; a positive force is repulsive")
    if not np.array_equal(packed, before):
        raise PluginError("two people of 80 kg: the law changes its parameters; only return the force")


def check_free_walk(model: ContactModel, pace: Pace) -> None:
    """Check that a person without contacts moves by eq. 33, bitwise equal alone and with distant people."""
    n, speed, tau = 60, 1.5, 0.5
    scene = f"a person without contacts, {pace}"
    alone, _ = walked(model, make_crowd([[0.0, 0.0]], speed=speed, tau=tau), n, pace=pace)
    two, _ = walked(model, make_crowd([[0.0, 0.0], [0.0, 5.0]], speed=speed, tau=tau), n, pace=pace)
    share = pace.step / (pace.slow * tau)
    exact = speed if model.overdamped else speed * (1.0 - (1.0 - share) ** (n * pace.parts))
    if not np.allclose(alone.velocity[0], [exact, 0.0], rtol=0.0, atol=1e-9):
        raise PluginError(
            f"{scene}: walks at {alone.velocity[0, 0] / pace.slow:.9f} m/s after {n * pace.parts} steps, not at"
            f" {exact / pace.slow:.9f} m/s; without contacts, the velocity after a step must be the free velocity"
        )
    if not np.array_equal(alone.position[0], two.position[0]):
        raise PluginError(f"{scene}: a person 5 m away changes a free walk; use only the given contacts")


def check_momentum(model: ContactModel, pace: Pace) -> None:
    """Check that two people who collide conserve their total momentum and do not pass through each other."""
    if model.overdamped:
        return
    scene = f"two people who collide, {pace}"
    crowd = make_crowd([[-0.3, 0.0], [0.3, 0.1]], velocity=[[1.5, 0.0], [-1.0, 0.2]], mass=[60.0, 100.0], tau=1e12)
    before = crowd.mass @ crowd.velocity
    start = crowd.velocity.copy()
    crowd, _ = walked(model, crowd, 40, pace=pace)
    lost = float(np.abs(crowd.mass @ crowd.velocity - before).max()) / pace.slow
    if not lost <= 1e-6:
        raise PluginError(
            f"{scene}: change their total momentum by {lost:.3g} kg m/s; percussions on both must be opposite and equal"
        )
    if np.allclose(crowd.velocity, start, atol=1e-3):
        raise PluginError(f"{scene}: walk through each other; solve the given contacts")


def check_turn_and_shift(model: ContactModel, pace: Pace) -> None:
    """Check that the motion is invariant under rotation by 90 degrees and translation of the scene."""
    plain = pressed(model, 60, pace=pace)[0].position
    for what, turn, shift in (("rotated by 90 degrees", True, 0.0), ("shifted", False, 3.25)):
        moved = pressed(model, 60, turn, shift, pace=pace)[0].position - shift
        if turn:
            moved = np.column_stack([moved[:, 1], -moved[:, 0]])
        apart = float(np.abs(moved - plain).max())
        if not apart <= TURN_TOLERANCE:
            raise PluginError(
                f"nine people pressed against a wall, {what}, {pace}: the motion differs by {apart:.3g} m; "
                "use gaps and normals, not coordinates"
            )


def check_coincident_centres(model: ContactModel, pace: Pace) -> None:
    """Check that coincident people, and a person on a wall, do not lead to NaN."""
    crowd = coincident(model, pace)
    if not (np.isfinite(crowd.position).all() and np.isfinite(crowd.velocity).all()):
        raise PluginError(f"two people at one place, {pace}: lead to NaN; do not divide by a distance or a gap")


def check_walls(model: ContactModel, pace: Pace) -> None:
    """Check that a crowd pressed against a wall, and a person pushed towards it, remain inside."""
    felt: list[float] = []
    crowd, engine = pressed(model, 200, watch=lambda crowd: felt.append(float(crowd.contact_force.max())), pace=pace)
    flying, _ = thrown(model, pace)
    many, one = f"nine people pressed against a wall, {pace}", f"a person pushed towards a wall, {pace}"
    for scene, people in ((many, crowd), (one, flying)):
        outside = np.flatnonzero(np.abs(people.position).max(axis=1) > ROOM)
        if len(outside):
            x, y = people.position[outside[0]]
            raise PluginError(
                f"{scene}: a person passed through the wall, at ({x:.2f}, {y:.2f}); apply percussions at walls too"
            )
    if not model.overdamped and not max(felt) > 0.0:
        raise PluginError(f"{many}: they have no contact force; set contacts.percussion")
    for key, value in engine.report().items():
        if not (math.isfinite(value) and (value >= 0.0 or key in SIGNED)):
            raise PluginError(f"{many}: reports {key} = {value}; it must be finite and not negative")


def check_report(model: ContactModel, pace: Pace) -> None:
    """Check that the report counts steps and contacts, and contains the largest overlap."""
    seen: list[float] = []
    _, engine = pressed(model, 200, watch=lambda crowd: seen.append(greatest_overlap(crowd)), pace=pace)
    report, steps = engine.report(), 200 * pace.parts
    scene = f"nine people pressed against a wall, {pace}"
    if report["steps"] != steps or report["sub_steps"] < steps or report["contacts"] <= 0:
        raise PluginError(
            f"{scene}: reports {report['steps']:.0f} steps, {report['sub_steps']:.0f} sub-steps and "
            f"{report['contacts']:.0f} contacts after {steps} steps; "
            "let the step loop of evac.physics.driver make the steps"
        )
    if report["greatest_overlap"] < max(seen[:-1]) - 1e-9:
        raise PluginError(
            f"{scene}: reports a largest overlap of {report['greatest_overlap']:.2g} m, but one of "
            f"{max(seen[:-1]):.2g} m occurred; let the step loop of evac.physics.driver make the steps"
        )


def check_energy(model: ContactModel, pace: Pace) -> None:
    """Check that the percussions of a head-on collision account for the change of kinetic energy."""
    if model.overdamped:
        return
    crowd = make_crowd([[-0.3, 0.0], [0.3, 0.0]], velocity=[[1.5, 0.0], [-1.0, 0.0]], mass=[60.0, 100.0], tau=1e12)
    start = crowd.velocity.copy()
    crowd, engine = walked(model, crowd, 40, pace=pace)
    report = engine.report()
    gained = 0.5 * float(crowd.mass @ (crowd.velocity**2 - start**2).sum(axis=1)) / pace.slow**2
    told = report["driving_work"] - report["contact_dissipation"] + report["contact_creation"]
    if not abs(told - gained) <= 1e-6 * (abs(gained) + 1.0):
        raise PluginError(
            f"two people who collide, {pace}: gain {gained:.4g} J, but their percussions account for "
            f"{told:.4g} J; contacts.percussion must contain the percussions that changed the velocities"
        )


CONTACT_MODEL_CHECKS: tuple[Callable[[ContactModel, Pace], None], ...] = (
    check_pair_law,
    check_free_walk,
    check_momentum,
    check_turn_and_shift,
    check_coincident_centres,
    check_walls,
    check_report,
    check_energy,
)
