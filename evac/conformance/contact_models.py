"""What contact models have to hold to, in small scenes made by hand."""

import math
from collections.abc import Callable

import numpy as np

from evac.conformance.scenes import ROOM, STEP, greatest_overlap, pressed, room, walked
from evac.errors import PluginError
from evac.physics.contact_model import ContactModel
from evac.physics.state import make_crowd

#: How far positions may differ after a turn or a shift of the whole scene [m]; iterative solvers stop earlier or later.
TURN_TOLERANCE = 1e-4

#: Sums of the report that may be negative.
SIGNED = ("driving_work", "contact_dissipation", "contact_creation")


def check_free_walk(model: ContactModel) -> None:
    """Who touches nobody walks as eq. 33 says, to the last bits the same alone and with others far away."""
    n, speed, tau = 60, 1.5, 0.5
    alone, _ = walked(model, make_crowd([[0.0, 0.0]], speed=speed, tau=tau), n)
    two, _ = walked(model, make_crowd([[0.0, 0.0], [0.0, 5.0]], speed=speed, tau=tau), n)
    exact = speed if model.overdamped else speed * (1.0 - (1.0 - STEP / tau) ** n)
    if not np.allclose(alone.velocity[0], [exact, 0.0], rtol=0.0, atol=1e-9):
        raise PluginError(
            f"{model.name}: somebody who touches nobody walks at {alone.velocity[0, 0]:.9f} m/s after {n} steps, "
            f"not at {exact:.9f} m/s; without contacts the velocity after a step must be the free one"
        )
    if not np.array_equal(alone.position[0], two.position[0]):
        raise PluginError(f"{model.name}: somebody 5 m away changes a free walk; use only the contacts given")


def check_momentum(model: ContactModel) -> None:
    """Two people who run into each other keep their common momentum, and do feel each other."""
    if model.overdamped:
        return
    crowd = make_crowd([[-0.3, 0.0], [0.3, 0.1]], velocity=[[1.5, 0.0], [-1.0, 0.2]], mass=[60.0, 100.0], tau=1e12)
    before = crowd.mass @ crowd.velocity
    start = crowd.velocity.copy()
    crowd, _ = walked(model, crowd, 40)
    lost = float(np.abs(crowd.mass @ crowd.velocity - before).max())
    if not lost <= 1e-6:
        raise PluginError(
            f"{model.name}: two people who run into each other change their common momentum by {lost:.3g} kg m/s; "
            "what pushes one must push the other back"
        )
    if np.allclose(crowd.velocity, start, atol=1e-3):
        raise PluginError(f"{model.name}: two people walk through each other; solve the contacts given")


def check_turn_and_shift(model: ContactModel) -> None:
    """A scene turned by 90 degrees, or shifted, gives the same motion, turned or shifted."""
    plain = pressed(model, 60)[0].position
    for what, turn, shift in (("turned by 90 degrees", True, 0.0), ("shifted", False, 3.25)):
        moved = pressed(model, 60, turn, shift)[0].position - shift
        if turn:
            moved = np.column_stack([moved[:, 1], -moved[:, 0]])
        apart = float(np.abs(moved - plain).max())
        if not apart <= TURN_TOLERANCE:
            raise PluginError(
                f"{model.name}: a scene {what} moves differently, by {apart:.3g} m; "
                "use gaps and normals, not coordinates"
            )


def check_coincident_centres(model: ContactModel) -> None:
    """Two people at one place, and one on a wall, give no NaN."""
    crowd = make_crowd([[0.0, 0.0], [0.0, 0.0], [ROOM, 0.0]], speed=1.0)
    crowd, _ = walked(model, crowd, 20, walls=room())
    if not (np.isfinite(crowd.position).all() and np.isfinite(crowd.velocity).all()):
        raise PluginError(f"{model.name}: two people at one place end in NaN; never divide by a distance or a gap")


def check_walls(model: ContactModel) -> None:
    """A crowd pressed against a wall, and somebody thrown at it, stay inside."""
    felt: list[float] = []
    crowd, engine = pressed(model, 200, watch=lambda crowd: felt.append(float(crowd.contact_force.max())))
    thrown, _ = walked(model, make_crowd([[2.0, 0.0]], velocity=[[10.0, 0.0]], speed=2.0, tau=0.1), 50, walls=room())
    for people in (crowd, thrown):
        outside = np.flatnonzero(np.abs(people.position).max(axis=1) > ROOM)
        if len(outside):
            x, y = people.position[outside[0]]
            raise PluginError(
                f"{model.name}: somebody is through the wall, at ({x:.2f}, {y:.2f}); push against walls too"
            )
    if not model.overdamped and not max(felt) > 0.0:
        raise PluginError(
            f"{model.name}: nobody pressed against a wall reports a contact force; fill contacts.percussion"
        )
    for key, value in engine.report().items():
        if not (math.isfinite(value) and (value >= 0.0 or key in SIGNED)):
            raise PluginError(f"{model.name}: reports {key} = {value}; counts and sizes are finite and not negative")


def check_report(model: ContactModel) -> None:
    """The report counts the steps and contacts, and knows the greatest overlap that can be seen."""
    seen: list[float] = []
    _, engine = pressed(model, 200, watch=lambda crowd: seen.append(greatest_overlap(crowd)))
    report = engine.report()
    if report["steps"] != 200 or report["sub_steps"] < 200 or report["contacts"] <= 0:
        raise PluginError(
            f"{model.name}: reports {report['steps']:.0f} steps, {report['sub_steps']:.0f} sub-steps and "
            f"{report['contacts']:.0f} contacts after 200 steps of a pressed crowd; "
            "let the step loop of evac.physics.driver make the steps"
        )
    if report["greatest_overlap"] < max(seen[:-1]) - 1e-9:
        raise PluginError(
            f"{model.name}: reports a greatest overlap of {report['greatest_overlap']:.2g} m where one of "
            f"{max(seen[:-1]):.2g} m is seen"
        )


def check_energy(model: ContactModel) -> None:
    """The percussions of two people who run head-on into each other account for their kinetic energy."""
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
            f"{model.name}: two people who run into each other gain {gained:.4g} J, but their percussions account for "
            f"{told:.4g} J; contacts.percussion must hold what changed the velocities"
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
