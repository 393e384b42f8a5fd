"""Checks of contact models in small artificial scenes, at a pace that suits their stiffness."""

import math
from collections.abc import Callable

import numpy as np

from evac.conformance.failures import CheckError, examining, scene
from evac.conformance.scenes import (
    COINCIDENT,
    PRESSED,
    THROWN,
    WALLS,
    Pace,
    coincident,
    greatest_overlap,
    pressed,
    refuse_outside,
    thrown,
    walked,
)
from evac.physics.contact.model import ContactModel
from evac.physics.contact.packing import packed_row
from evac.physics.contact.pair_contact import PairContact
from evac.physics.state import make_crowd

#: Tolerance of positions after rotating or shifting a scene [m]; the iteration counts of solvers may differ.
TURN_TOLERANCE = 1e-4

#: Sums of the report that may be negative.
SIGNED = ("driving_work", "contact_dissipation", "contact_creation")


def check_pair_law(model: PairContact) -> None:
    """Check that the law of a single contact is finite and repulsive, and has no side effects."""
    with examining("its function pair"):
        model.check_pair()
        packed = packed_row(model, f"contact model {model.name!r}")
    before, greatest = packed.copy(), 0.0
    for overlap in (0.0, 1e-9, 1e-3, 0.05, 0.2, 0.4):
        for closing in (-2.0, 0.0, 2.0):
            with scene(f"two people of 80 kg, overlap {overlap} m, closing speed {closing} m/s"):
                greatest = max(greatest, model.force(-overlap, closing, 40.0, packed))
    with scene("two people of 80 kg, all overlaps up to 0.4 m"):
        if not greatest > 0.0:
            raise CheckError(
                "the force is never positive", "return a positive force, which is repulsive, for a negative gap"
            )
        if not np.array_equal(packed, before):
            raise CheckError("the law changes its parameters", "only return the force")


def check_free_walk(model: ContactModel, pace: Pace) -> None:
    """Check that a person without contacts moves by eq. 33, bitwise equal alone and with distant people."""
    n, speed, tau = 60, 1.5, 0.5
    with scene(f"a person without contacts, {pace}"):
        alone, _ = walked(model, make_crowd([[0.0, 0.0]], speed=speed, tau=tau), n, pace=pace)
        share = pace.step / (pace.slow * tau)
        exact = speed if model.overdamped else speed * (1.0 - (1.0 - share) ** (n * pace.parts))
        if not np.allclose(alone.velocity[0], [exact, 0.0], rtol=0.0, atol=1e-9):
            raise CheckError(
                f"walks at {alone.velocity[0, 0] / pace.slow:.9f} m/s after {n * pace.parts} steps, not at"
                f" {exact / pace.slow:.9f} m/s",
                "without contacts, the velocity after a step must be the free velocity",
            )
    with scene(f"two people 5 m apart, {pace}"):
        two, _ = walked(model, make_crowd([[0.0, 0.0], [0.0, 5.0]], speed=speed, tau=tau), n, pace=pace)
        if not np.array_equal(alone.position[0], two.position[0]):
            apart = float(np.abs(alone.position[0] - two.position[0]).max())
            raise CheckError(f"a person 5 m away changes a free walk by {apart:.3g} m", "use only the given contacts")


def check_momentum(model: ContactModel, pace: Pace) -> None:
    """Check that two people who collide conserve their total momentum and do not pass through each other."""
    if model.overdamped:
        return
    with scene(f"two people who collide, {pace}"):
        crowd = make_crowd([[-0.3, 0.0], [0.3, 0.1]], velocity=[[1.5, 0.0], [-1.0, 0.2]], mass=[60.0, 100.0], tau=1e12)
        before = crowd.mass @ crowd.velocity
        start = crowd.velocity.copy()
        crowd, _ = walked(model, crowd, 40, pace=pace)
        lost = float(np.abs(crowd.mass @ crowd.velocity - before).max()) / pace.slow
        if not lost <= 1e-6:
            raise CheckError(
                f"their total momentum changes by {lost:.3g} kg m/s", "percussions on both must be opposite and equal"
            )
        if np.allclose(crowd.velocity, start, atol=1e-3):
            raise CheckError("they walk through each other", "change the velocities of bodies with a negative gap")


def check_turn_and_shift(model: ContactModel, pace: Pace) -> None:
    """Check that the motion is invariant under rotation by 90 degrees and translation of the scene."""
    with scene(f"{PRESSED}, {pace}"):
        plain = pressed(model, 60, pace=pace)[0].position
    for what, turn, shift in (("rotated by 90 degrees", True, 0.0), ("shifted", False, 3.25)):
        with scene(f"{PRESSED}, {what}, {pace}"):
            moved = pressed(model, 60, turn, shift, pace=pace)[0].position - shift
            if turn:
                moved = np.column_stack([moved[:, 1], -moved[:, 0]])
            apart = float(np.abs(moved - plain).max())
            if not apart <= TURN_TOLERANCE:
                raise CheckError(f"the motion differs by {apart:.3g} m", "use gaps and normals, not coordinates")


def check_coincident_centres(model: ContactModel, pace: Pace) -> None:
    """Check that coincident people, and a person on a wall, do not lead to NaN."""
    with scene(f"{COINCIDENT}, {pace}"):
        crowd = coincident(model, pace)
        if not (np.isfinite(crowd.position).all() and np.isfinite(crowd.velocity).all()):
            raise CheckError("positions or velocities are NaN", "do not divide by a distance or a gap")


def check_walls(model: ContactModel, pace: Pace) -> None:
    """Check that a crowd pressed against a wall, and a person pushed towards it, remain inside."""
    felt: list[float] = []
    with scene(f"{PRESSED}, {pace}", WALLS):
        crowd, engine = pressed(
            model, 200, watch=lambda crowd: felt.append(float(crowd.contact_force.max())), pace=pace
        )
        refuse_outside(crowd)
        report = engine.report()
        work = report["contact_dissipation"] + report["contact_creation"]
        is_felt = max(felt) > 0.0 or (model.reports_percussions and work > 0.0)  # stiff contacts end between two ticks
        if not model.overdamped and not is_felt:
            raise CheckError("people have no contact force", "set contacts.percussion")
        for key, value in report.items():
            if not (math.isfinite(value) and (value >= 0.0 or key in SIGNED)):
                raise CheckError(f"reports {key} = {value}", "percussions must be finite and not negative")
    with scene(f"{THROWN}, {pace}", WALLS):
        refuse_outside(thrown(model, pace)[0])


def check_report(model: ContactModel, pace: Pace) -> None:
    """Check that the report counts steps and contacts, and contains the largest overlap."""
    remedy = "let the step loop of evac.physics.driver make the steps"
    seen: list[float] = []
    with scene(f"{PRESSED}, {pace}"):
        _, engine = pressed(model, 200, watch=lambda crowd: seen.append(greatest_overlap(crowd)), pace=pace)
        report, steps = engine.report(), 200 * pace.parts
        if report["steps"] != steps or report["sub_steps"] < steps or report["contacts"] <= 0:
            raise CheckError(
                f"reports {report['steps']:.0f} steps, {report['sub_steps']:.0f} sub-steps and "
                f"{report['contacts']:.0f} contacts after {steps} steps",
                remedy,
            )
        if report["greatest_overlap"] < max(seen[:-1]) - 1e-9:
            raise CheckError(
                f"reports a largest overlap of {report['greatest_overlap']:.2g} m, but one of {max(seen[:-1]):.2g} m"
                " occurred",
                remedy,
            )


def check_energy(model: ContactModel, pace: Pace) -> None:
    """Check that the percussions of a head-on collision account for the change of kinetic energy."""
    if model.overdamped:
        return
    with scene(f"two people who collide head-on, {pace}"):
        crowd = make_crowd([[-0.3, 0.0], [0.3, 0.0]], velocity=[[1.5, 0.0], [-1.0, 0.0]], mass=[60.0, 100.0], tau=1e12)
        start = crowd.velocity.copy()
        crowd, engine = walked(model, crowd, 40, pace=pace)
        report = engine.report()
        gained = 0.5 * float(crowd.mass @ (crowd.velocity**2 - start**2).sum(axis=1)) / pace.slow**2
        told = report["driving_work"] - report["contact_dissipation"] + report["contact_creation"]
        if not abs(told - gained) <= 1e-6 * (abs(gained) + 1.0):
            raise CheckError(
                f"they gain {gained:.4g} J, but their percussions account for {told:.4g} J",
                "contacts.percussion must contain the percussions that changed the velocities",
            )


CONTACT_MODEL_CHECKS: tuple[Callable[[ContactModel, Pace], None], ...] = (
    check_free_walk,
    check_momentum,
    check_coincident_centres,
    check_walls,
    check_turn_and_shift,
    check_report,
    check_energy,
)
