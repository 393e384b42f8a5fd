"""From one tolerance [m] to the step and the solver's tolerances: `evac run --tolerance 0.001`."""

import math
from typing import TYPE_CHECKING, Any

from evac.errors import ScenarioError
from evac.people.distributions import Distribution
from evac.scenario.keys import Factor

if TYPE_CHECKING:
    from evac.scenario.case import Case

#: Error of positions over v h: the greatest that docs/evidence/accuracy, part b, measures at h <= 0.01 s, rounded up.
ERROR_PER_PATH = 2.5

#: Share of the tolerance that a solver may use up: its gap tolerance, and its velocity tolerance over `RELAXATION`.
SOLVER_SHARE = 0.1
RELAXATION = 1.0  # s

#: The rule never makes a step longer than this; a tolerance that asks for less than `SHORTEST` is refused [s].
LONGEST = 0.01
SHORTEST = 1e-6

#: A distribution without greatest speed counts as this many times its mean.
UNBOUNDED = 3.0


def settings_for(case: "Case", tolerance: float) -> dict[str, Any]:
    """Return the overrides of a case that keep the numerical error of positions below a tolerance.

    All models are of first order wherever contacts open and close: in one step a person walks v h, and when in
    the step a contact falls is not known. So, with v the greatest speed in the case,

    - step: ``h = tolerance / (ERROR_PER_PATH v)``, at most `LONGEST`, shortened to a divisor of the tick;
    - gap tolerance (where the model has one): ``SOLVER_SHARE tolerance``; overlaps, which can add up
      over steps to some times that, stay below the tolerance;
    - velocity tolerance (where the model has one): ``SOLVER_SHARE tolerance / RELAXATION``, at most its default: an
      error of velocity is forgotten within the relaxation time tau, after a displacement of its size times tau.

    What the rule does not control: the growth of any error by chaos in a jam, where single trajectories are
    not determined (egress statistics are); DEM's overlap, which is F/k at any step; the grid of directions.

    Parameters
    ----------
    case : Case
    tolerance : float
        Of positions [m].

    Returns
    -------
    dict
        Dotted keys and values, for `Case.change`.

    Raises
    ------
    ScenarioError
        The tolerance is not positive, or needs steps below `SHORTEST`.
    """
    if not 0.0 < tolerance < math.inf:
        raise ScenarioError(f"tolerance: must be greater than 0 m, got {tolerance!r}")
    speed = greatest_speed(case)
    wanted = min(LONGEST, tolerance / (ERROR_PER_PATH * speed)) if speed > 0.0 else LONGEST
    if wanted < SHORTEST:
        raise ScenarioError(
            f"tolerance: {tolerance:g} m at {speed:g} m/s needs steps of {wanted:.1e} s, below {SHORTEST:g} s; "
            f"the least tolerance here is {SHORTEST * ERROR_PER_PATH * speed:.1e} m"
        )
    tick = case.simulation.tick
    chosen: dict[str, Any] = {"simulation.step": tick / math.ceil(tick / wanted * (1.0 - 1e-12))}
    name = case.contact.model
    declared = case.registry.get("contact_model", name).declared()
    if "gap_tolerance" in declared:
        chosen[f"contact.{name}.gap_tolerance"] = SOLVER_SHARE * tolerance
    if "velocity_tolerance" in declared:
        share = SOLVER_SHARE * tolerance / RELAXATION
        chosen[f"contact.{name}.velocity_tolerance"] = min(declared["velocity_tolerance"].default, share)
    return chosen


def greatest_speed(case: "Case") -> float:
    """Return the greatest speed that somebody in a case wants, on the flat or on stairs, or starts with [m/s]."""
    speeds = [0.0]
    for group in case.people:
        flat = _greatest(group.speed)
        speeds.append(flat)
        for given in () if group.limit_stair_speeds else (group.speed_up, group.speed_down):
            speeds.append(flat * _greatest(given.factor) if isinstance(given, Factor) else _greatest(given))
        speeds += [math.hypot(x, y) for x, y in group.velocity or ()]
    return max(speeds)


def _greatest(values: Distribution) -> float:
    bound = values.support()[1]
    return bound if bound < math.inf else UNBOUNDED * values.mean()
