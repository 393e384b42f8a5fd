"""Checks of laws of the speed in smoke, and of sources of the conditions of the air."""

import numpy as np

from evac.case.case import Case
from evac.conditions.law import SmokeLaw
from evac.conformance.failures import examining, require
from evac.simulation.simulation import Simulation

#: Desired speeds [m/s], and extinction coefficients [1/m] from clear air to smoke in which nothing is seen.
SPEEDS = (0.0, 0.2, 0.8, 1.25, 2.0)
SMOKE = (0.0, 0.01, 0.1, 0.5, 1.0, 3.0, 10.0, 100.0)


def check_speeds(law: SmokeLaw) -> None:
    """Check that speeds are finite, one for each person, and the desired ones in clear air; arguments are kept."""
    desired, extinction = (values.ravel() for values in np.meshgrid(SPEEDS, SMOKE))
    given = desired.copy(), extinction.copy()
    with examining("its speed()"):
        speed = np.asarray(law.speed(desired, extinction))
        require(
            speed.shape == desired.shape, f"returns {speed.shape}, not {desired.shape}", "return one for each person"
        )
        require(
            bool(np.isfinite(speed).all()), "returns a speed that is not finite", "check extinction coefficients of 0"
        )
        kept = (desired == given[0]).all() and (extinction == given[1]).all()
        require(bool(kept), "changes its arguments", "return a new array")
        clear = np.clip(speed, 0.0, desired)[extinction == 0.0]
        require(bool((clear == SPEEDS).all()), "slows people in clear air", "return the desired speeds where K is 0")


def check_people_are_independent(law: SmokeLaw) -> None:
    """Check that the speed of each person follows from its own extinction coefficient alone."""
    desired, extinction = np.full(len(SMOKE), 1.25), np.array(SMOKE)
    with examining("its speed()"):
        together = law.speed(desired, extinction)
        alone = np.array([law.speed(desired[k : k + 1], extinction[k : k + 1])[0] for k in range(len(SMOKE))])
        wrong = "gives a person another speed if others are there"
        require(bool((together == alone).all()), wrong, "use only the values of each person")


def check_source(case: Case) -> None:
    """Check that a source gives values at people's heads, which `Air` checks, and the same ones each time."""
    simulation = Simulation(case, will_run=False)
    assert simulation.exposure is not None
    air, crowd = simulation.exposure.air, simulation.population.crowd
    heads = air.heads_at(crowd.level, crowd.position, crowd.height)
    with examining("its at()"):
        values = air.at(air.quantities, 0.0, crowd.level, crowd.position, heads)
        again = air.at(air.quantities, 0.0, crowd.level, crowd.position, heads)
        require(
            bool((values == again).all()),
            "gives other values when it is asked again",
            "compute them from place and time",
        )


#: The checks of every law.
LAW_CHECKS = (check_speeds, check_people_are_independent)
