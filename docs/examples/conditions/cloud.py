"""A source of smoke."""

import numpy as np

from evac import ConditionSource, Parameter


class Cloud(ConditionSource):
    """A cloud of smoke that moves along x."""

    name = "cloud"
    speed = Parameter(1.0, "speed of the cloud", "m/s", minimum=0.0, maximum=10.0)

    def open(self, scene):
        """Return the names of its quantities."""
        return ["extinction"]

    def at(self, quantities, time, level, position, height):
        """Return the extinction coefficient [1/m]."""
        return 2.0 * np.exp(-((position[None, :, 0] - self.speed * time) ** 2))


evac_interface = 3
