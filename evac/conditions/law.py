"""Speed in smoke: the base class of laws, and the additional effect of irritant gases."""

from abc import ABC, abstractmethod
from typing import ClassVar

import numpy as np

from evac.base.arrays import COPY, FloatArray, as_floats, read_only
from evac.base.errors import fault, plugin_code
from evac.base.parameters import Configurable

SMOKE = "extinction"  #: Name of the extinction coefficient, as a quantity and as a recorded field.

#: Name of the recorded field of the speed that smoke and irritants leave of the mean desired speed.
SPEED = "speed_in_smoke"

DENSE = 1e4  #: Extinction coefficient of smoke so dense that laws have their least speed [1/m].

#: Extinction coefficients among which that is found from which on people are slower than they are when they wait [1/m].
THICK = np.geomspace(0.1, 100.0, 301)

WAITING_SPEED = 0.2  #: People slower than this wait [m/s].
LEAST_SHARE = 0.1  #: Least share of the speed in irritants, if a law states no least speed: that of FDS+Evac in smoke.


class SmokeLaw(Configurable, ABC):
    """How fast people walk in smoke: the base class of such laws.

    The same law is applied to people, and to the travel times of routes. Speeds that it returns are limited to those
    between zero and the desired speed.
    """

    #: Whether the law was measured in irritant smoke, so that the effect of irritant gases is not added.
    is_irritant: ClassVar[bool] = False

    #: Whether it needs the extinction coefficient.
    needs_extinction: ClassVar[bool] = True

    @abstractmethod
    def speed(self, desired: FloatArray, extinction: FloatArray) -> FloatArray:
        """Return the speeds (n,) of people in smoke [m/s].

        Parameters
        ----------
        desired : (n,) float64 [m/s]
            Their desired speeds in clear air, on the flat or on the stairs on which they are, along the slope.
        extinction : (n,) float64 [1/m]
            Extinction coefficients K at their heads.
        """


def share_in_smoke(
    law: SmokeLaw, desired: FloatArray, extinction: FloatArray, irritants: FloatArray | None
) -> FloatArray:
    """Return the share (n,) of the desired speeds [m/s] that smoke and irritant gases leave.

    Extinction coefficients are in 1/m, irritants on the scale of incapacitation. The losses are added, and not both
    counted if the law was measured in irritant smoke. The law's speed in the densest smoke stays, so that irritants
    halt nobody; `LEAST_SHARE` stays if that is zero, or the law needs no extinction.
    """
    with plugin_code(f"law {law.name!r}: speed", law, COPY):
        speed = as_floats(law.speed(read_only(desired), read_only(extinction)))
    if speed.shape != desired.shape or not np.isfinite(speed).all():
        wrong = (
            f"returns {speed.shape} speeds for {desired.shape} people"
            if speed.shape != desired.shape
            else "is not finite"
        )
        raise fault(f"law {law.name!r}: speed", wrong, "return a finite speed for each person", law, "speed")
    speed = np.clip(speed, 0.0, desired)
    share: FloatArray = np.divide(speed, desired, out=np.ones_like(desired), where=desired > 0.0)
    if irritants is not None and not law.is_irritant:
        least = np.minimum(share, LEAST_SHARE)
        if law.needs_extinction:
            with plugin_code(f"law {law.name!r}: speed", law, COPY):
                dense = as_floats(law.speed(read_only(desired), read_only(np.full_like(desired, DENSE))))
            least = np.minimum(share, np.divide(dense, desired, out=least, where=(desired > 0.0) & (dense > 0.0)))
        share = np.clip(share - (1.0 - share_with_irritants(irritants)), least, 1.0)
    return share


def share_with_irritants(concentration: FloatArray) -> FloatArray:
    """Return the share (n,) of the speed that fractional irritant concentrations (n,) leave: SFPE, eq. 63.13."""
    share: FloatArray = (np.exp(-((1000.0 * concentration / 160.0) ** 2)) + 0.2 - 0.2 * concentration) / 1.2
    return np.clip(share, 0.0, 1.0)


def slow_from(law: SmokeLaw, desired: float) -> float | None:
    """Return the extinction coefficient from which on people with a desired speed are slower than when they wait."""
    speeds = np.full_like(THICK, desired)
    slow = THICK[speeds * share_in_smoke(law, speeds, THICK, None) < WAITING_SPEED]
    return float(slow[0]) if len(slow) else None
