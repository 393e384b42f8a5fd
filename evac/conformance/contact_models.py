"""Checks of contact models in small artificial scenes."""

import math
from collections.abc import Callable

import numpy as np

from evac.conformance.scenes import ROOM, STEP, greatest_overlap, pressed, room, walked
from evac.errors import PluginError
from evac.physics.contact_model import ContactModel
from evac.physics.state import make_crowd

#: Tolerance of positions after rotating or shifting a scene [m]; the iteration counts of solvers may differ.
TURN_TOLERANCE = 1e-4

#: Sums of the report that may be negative.
SIGNED = ("driving_work", "contact_dissipation", "contact_creation")


def check_free_walk(model: ContactModel) -> None:
    """Check that a person without contacts moves by eq. 33, bitwise equal alone and with distant people."""
    n, speed, tau = 60, 1.5, 0.5
    alone, _ = walked(model, make_crowd([[0.0, 0.0]], speed=speed, tau=tau), n)
    two, _ = walked(model, make_crowd([[0.0, 0.0], [0.0, 5.0]], speed=speed, tau=tau), n)
    exact = speed if model.overdamped else speed * (1.0 - (1.0 - STEP / tau) ** n)
    if not np.allclose(alone.velocity[0], [exact, 0.0], rtol=0.0, atol=1e-9):
        raise PluginError(
            f"{model.name}: a person without contacts walks at {alone.velocity[0, 0]:.9f} m/s after {n} steps, "
            f"not at {exact:.9f} m/s; without contacts, the velocity after a step must be the free velocity"
        )
    if not np.array_equal(alone.position[0], two.position[0]):
        raise PluginError(f"{model.name}: a person 5 m away changes a free walk; use only the given contacts")


def check_momentum(model: ContactModel) -> None:
    """Check that two people who collide conserve their total momentum and do not pass through each other."""
    if model.overdamped:
        return
    crowd = make_crowd([[-0.3, 0.0], [0.3, 0.1]], velocity=[[1.5, 0.0], [-1.0, 0.2]], mass=[60.0, 100.0], tau=1e12)
    before = crowd.mass @ crowd.velocity
    start = crowd.velocity.copy()
    crowd, _ = walked(model, crowd, 40)
    lost = float(np.abs(crowd.mass @ crowd.velocity - before).max())
    if not lost <= 1e-6:
        raise PluginError(
            f"{model.name}: two people who collide change their total momentum by {lost:.3g} kg m/s; "
            "percussions on both must be opposite and equal"
        )
    if np.allclose(crowd.velocity, start, atol=1e-3):
        raise PluginError(f"{model.name}: two people walk through each other; solve the given contacts")


def check_turn_and_shift(model: ContactModel) -> None:
    """Check that the motion is invariant under rotation by 90 degrees and translation of the scene."""
    plain = pressed(model, 60)[0].position
    for what, turn, shift in (("rotated by 90 degrees", True, 0.0), ("shifted", False, 3.25)):
        moved = pressed(model, 60, turn, shift)[0].position - shift
        if turn:
            moved = np.column_stack([moved[:, 1], -moved[:, 0]])
        apart = float(np.abs(moved - plain).max())
        if not apart <= TURN_TOLERANCE:
            raise PluginError(
                f"{model.name}: the motion in a scene {what} differs by {apart:.3g} m; "
                "use gaps and normals, not coordinates"
            )


def check_coincident_centres(model: ContactModel) -> None:
    """Check that coincident people, and a person on a wall, do not lead to NaN."""
    crowd = make_crowd([[0.0, 0.0], [0.0, 0.0], [ROOM, 0.0]], speed=1.0)
    crowd, _ = walked(model, crowd, 20, walls=room())
    if not (np.isfinite(crowd.position).all() and np.isfinite(crowd.velocity).all()):
        raise PluginError(f"{model.name}: two people at one place lead to NaN; do not divide by a distance or a gap")


def check_walls(model: ContactModel) -> None:
    """Check that a crowd pressed against a wall, and a person pushed towards it, remain inside."""
    felt: list[float] = []
    crowd, engine = pressed(model, 200, watch=lambda crowd: felt.append(float(crowd.contact_force.max())))
    thrown, _ = walked(model, make_crowd([[2.0, 0.0]], velocity=[[10.0, 0.0]], speed=2.0, tau=0.1), 50, walls=room())
    for people in (crowd, thrown):
        outside = np.flatnonzero(np.abs(people.position).max(axis=1) > ROOM)
        if len(outside):
            x, y = people.position[outside[0]]
            raise PluginError(
                f"{model.name}: a person passed through the wall, at ({x:.2f}, {y:.2f}); apply percussions at walls too"
            )
    if not model.overdamped and not max(felt) > 0.0:
        raise PluginError(f"{model.name}: people pressed against a wall have no contact force; set contacts.percussion")
    for key, value in engine.report().items():
        if not (math.isfinite(value) and (value >= 0.0 or key in SIGNED)):
            raise PluginError(f"{model.name}: reports {key} = {value}; it must be finite and not negative")


def check_report(model: ContactModel) -> None:
    """Check that the report counts steps and contacts, and contains the largest overlap."""
    seen: list[float] = []
    _, engine = pressed(model, 200, watch=lambda crowd: seen.append(greatest_overlap(crowd)))
    report = engine.report()
    if report["steps"] != 200 or report["sub_steps"] < 200 or report["contacts"] <= 0:
        raise PluginError(
            f"{model.name}: reports {report['steps']:.0f} steps, {report['sub_steps']:.0f} sub-steps and "
            f"{report['contacts']:.0f} contacts after 200 steps of a crowd under pressure; "
            "let the step loop of evac.physics.driver make the steps"
        )
    if report["greatest_overlap"] < max(seen[:-1]) - 1e-9:
        raise PluginError(
            f"{model.name}: reports a largest overlap of {report['greatest_overlap']:.2g} m, but one of "
            f"{max(seen[:-1]):.2g} m occurred; let the step loop of evac.physics.driver make the steps"
        )


def check_energy(model: ContactModel) -> None:
    """Check that the percussions of a head-on collision account for the change of kinetic energy."""
    if model.overdamped:
        return
    crowd = make_crowd([[-0.3, 0.0], [0.3, 0.0]], velocity=[[1.5, 0.0], [-1.0, 0.0]], mass=[60.0, 100.0], tau=1e12)
    start = crowd.velocity.copy()
    crowd, engine = walked(model, crowd, 40)
    report = engine.report()
    gained = 0.5 * float(crowd.mass @ (crowd.velocity**2 - start**2).sum(axis=1))
    told = report["driving_work"] - report["contact_dissipation"] + report["contact_creation"]
    if not abs(told - gained) <= 1e-6 * (abs(gained) + 1.0):
        raise PluginError(
            f"{model.name}: two people who collide gain {gained:.4g} J, but their percussions account for "
            f"{told:.4g} J; contacts.percussion must contain the percussions that changed the velocities"
        )


CONTACT_MODEL_CHECKS: tuple[Callable[[ContactModel], None], ...] = (
    check_free_walk,
    check_momentum,
    check_turn_and_shift,
    check_coincident_centres,
    check_walls,
    check_report,
    check_energy,
)
