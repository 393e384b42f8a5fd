"""People slow down where it is crowded."""

import numpy as np
from scipy.spatial import cKDTree

from evac import Behaviour, Parameter


class Crowding(Behaviour):
    """Each person within a radius takes a share of the desired speed, down to a least share."""

    name = "crowding"
    reads = ("position", "level", "speed_factor")
    writes = ("speed_factor",)

    radius = Parameter(1.0, "how far people count, from centre to centre", unit="m", above=0.0)
    loss = Parameter(0.05, "share of the speed that each of them takes", minimum=0.0, maximum=1.0)
    least = Parameter(0.3, "share of the speed that is always left", above=0.0, maximum=1.0)

    def act(self, crowd, time):
        """Set the factors of everybody inside; people on other levels do not count."""
        for level in np.unique(crowd.level[crowd.level >= 0]):
            here = np.flatnonzero(crowd.level == level)
            tree = cKDTree(crowd.position[here])
            near = tree.query_ball_point(crowd.position[here], self.radius, return_length=True) - 1
            crowd.speed_factor[here] *= np.maximum(self.least, 1.0 - self.loss * near)


evac_interface = 3
