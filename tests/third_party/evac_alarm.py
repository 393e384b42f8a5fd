"""People set off when the alarm reaches them: a third party's plugin for evac."""

import numpy as np

from evac import Behaviour, Parameter


class Alarm(Behaviour):
    """The alarm spreads from a point at a given speed; people start when it arrives, in plan, on every level."""

    name = "alarm"
    reads = ("position", "start_time")
    writes = ("start_time",)

    x = Parameter(0.0, "where it starts", unit="m")
    y = Parameter(0.0, "where it starts", unit="m")
    speed = Parameter(1.0, "how fast word spreads", unit="m/s", above=0.0)

    def prepare(self, scene):
        """Let nobody set off before the alarm."""
        distance = np.hypot(*(scene.crowd.position - [self.x, self.y]).T)
        scene.crowd.start_time[:] = np.maximum(scene.crowd.start_time, distance / self.speed)

    def acts_at_ticks(self):
        """Return False: everything is done before the first step."""
        return False


evac_interface = 3
