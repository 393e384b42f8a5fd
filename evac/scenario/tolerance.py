"""Time step and solver tolerances for a given error of positions [m]: `evac run --tolerance 0.001`."""

import math
from typing import TYPE_CHECKING, Any

from evac.errors import ScenarioError
from evac.people.distributions import Distribution
from evac.scenario.keys import Factor

if TYPE_CHECKING:
    from evac.scenario.case import Case

#: Ratio of the error of positions to v h: greatest value for h <= 0.01 s in docs/evidence/accuracy, part b, rounded up.
ERROR_PER_PATH = 2.5

#: Share of the tolerance allowed for the solver: its gap tolerance, and its velocity tolerance times `RELAXATION`.
SOLVER_SHARE = 0.1
RELAXATION = 1.0  # s

#: Longest step that the rule chooses; a tolerance that requires a step below `SHORTEST` is an error [s].
LONGEST = 0.01
SHORTEST = 1e-6

#: Greatest speed of an unbounded distribution, as a multiple of its mean.
UNBOUNDED = 3.0


def settings_for(case: "Case", tolerance: float) -> dict[str, Any]:
    """Return the overrides of a case that keep the numerical error of positions below a tolerance.

    All models are of first order where contacts open and close: a person walks v h in one step, and the time of a
    contact within the step is not resolved. So, with v the greatest speed in the case,

    - step: ``h = tolerance / (ERROR_PER_PATH v)``, at most `LONGEST`, shortened to a divisor of the tick;
    - gap tolerance (if the model has one): ``SOLVER_SHARE tolerance``; overlaps, which can accumulate over steps to
      a few times that, stay below the tolerance;
    - velocity tolerance (if the model has one): ``SOLVER_SHARE tolerance / RELAXATION``, at most its default: an
      error of velocity decays with the relaxation time tau, after a displacement of the error times tau.

    The rule does not control the chaotic growth of errors in a jam, where single trajectories are not determined
    (egress statistics are); DEM's overlap, which is F/k at any step; and errors of the grid of directions.

    Parameters
    ----------
    case : Case
    tolerance : float
        Allowed error of positions [m].

    Returns
    -------
    dict
        Dotted keys and values, for `Case.change`.

    Raises
    ------
    ScenarioError
        The tolerance is not positive, or requires steps below `SHORTEST`.
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
    """Return the greatest desired speed, on the flat or on stairs, or initial speed in a case [m/s]."""
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
