"""Laws of the speed in smoke; docs/fire_data.md compares their data."""

import numpy as np

from evac.base.arrays import FloatArray
from evac.base.parameters import Parameter
from evac.conditions.law import SmokeLaw


class FdsEvac(SmokeLaw):
    """A share of the desired speed, 1 - 0.057 K / 0.706, at least 0.1: FDS+Evac, equation 11.

    The coefficients are from Frantzich and Nilsson (2003), Lund report 3126: 46 people at K from 1.9 to 7.4 1/m.
    """

    name = "fds_evac"

    def speed(self, desired: FloatArray, extinction: FloatArray) -> FloatArray:
        """Return the share of the desired speeds."""
        return desired * np.maximum(0.1, 1.0 - 0.057 / 0.706 * extinction)


class Fridolf(SmokeLaw):
    """Desired speed less 0.34 m/s for each metre of visibility below 3 m, at least 0.2 m/s: Fridolf et al., equation 7.

    Tunnelling and Underground Space Technology 90 (2019) 28-41, data at visibilities of 0.3 to 3 m.
    """

    name = "fridolf"
    contrast = Parameter(2.0, "visibility times extinction coefficient: 2, or 8 for lit signs", minimum=1, maximum=20)

    def speed(self, desired: FloatArray, extinction: FloatArray) -> FloatArray:
        """Return the desired speeds less what visibility takes."""
        with np.errstate(divide="ignore"):
            visibility = np.minimum(self.contrast / extinction, 3.0)
        slowed: FloatArray = np.minimum(desired, np.maximum(0.2, desired - 0.34 * (3.0 - visibility)))
        return slowed


class Jin(SmokeLaw):
    """At most 1.0573 - 0.4326 K m/s and at least `floor`, in smoke that does not irritate: Purser's fit to Jin's data.

    Data: ten men who walked 20 m at K from 0.5 to 1.13 1/m. Below 0.5 1/m, the speed is linear in K.
    """

    name = "jin"
    floor = Parameter(0.3, "least speed, which was not measured", "m/s", minimum=0.0, maximum=1.0)
    fit, first = (1.0573, 0.4326), 0.5

    def speed(self, desired: FloatArray, extinction: FloatArray) -> FloatArray:
        """Return the speeds of the fit."""
        fit = np.maximum(self.floor, self.fit[0] - self.fit[1] * np.maximum(extinction, self.first))
        weight = np.minimum(extinction / self.first, 1.0)
        speed: FloatArray = np.minimum(desired, desired + weight * (fit - desired))
        return speed


class JinIrritant(Jin):
    """At most 1.1517 - 0.9578 K m/s and at least `floor`, in smoke that irritates: Purser's fit to Jin's data.

    Data: ten men who walked 20 m at K from 0.32 to 0.47 1/m. Below 0.32 1/m, the speed is linear in K.
    """

    name = "jin_irritant"
    is_irritant = True
    fit, first = (1.1517, 0.9578), 0.32


class Sfpe(SmokeLaw):
    """At most 0.6423 - 0.1364 ln K m/s, and at least `floor`: SFPE Handbook (2016), equation 63.10, of pooled data."""

    name = "sfpe"
    floor = Parameter(0.1, "least speed", "m/s", minimum=0.0, maximum=1.0)

    def speed(self, desired: FloatArray, extinction: FloatArray) -> FloatArray:
        """Return the speeds of the fit."""
        with np.errstate(divide="ignore"):
            fit: FloatArray = np.maximum(self.floor, 0.6423 - 0.1364 * np.log(extinction))
        return np.minimum(desired, fit)


class Unaffected(SmokeLaw):
    """Smoke does not reduce the speed."""

    name = "none"
    needs_extinction = False

    def speed(self, desired: FloatArray, extinction: FloatArray) -> FloatArray:
        """Return the desired speeds."""
        return desired
