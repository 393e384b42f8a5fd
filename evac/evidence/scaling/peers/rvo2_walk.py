"""ORCA by the library RVO2, from the package pyrvo: the model from which ORCA of the program Menge is derived."""

import numpy as np

from evac.base.arrays import FloatArray
from evac.evidence.scaling.halls import Hall, doors_along, nearest_door
from evac.evidence.scaling.walks import TICK, cpu_time

#: Defaults of Menge: neighbours and their greatest distance [m], greatest speed [m/s] (BaseAgent.cpp), time horizons
#: for people and for walls [s] (ORCAAgent.cpp).
NEIGHBOURS, REACH, FASTEST = 10, 5.0, 2.5
HORIZON, WALL_HORIZON = 2.5, 0.15


class OrcaWalk:
    """ORCA; everybody prefers to walk straight to the nearest door at the desired speed.

    People who have left the hall walk on and still take part in the steps, because the package cannot remove them.
    """

    def __init__(self, hall: Hall, step: float) -> None:
        import pyrvo

        self.depth, self.per_tick = hall.depth, round(TICK / step)
        self.radius, self.speed = hall.crowd.radius, hall.crowd.speed[:, 0]
        common = REACH, NEIGHBOURS, HORIZON, WALL_HORIZON
        self.simulator = pyrvo.RVOSimulator(step, *common, float(self.radius.max()), FASTEST)
        for place, radius in zip(hall.crowd.position.tolist(), self.radius.tolist(), strict=True):
            self.simulator.add_agent(place, *common, radius, FASTEST)
        for wall in hall.building.walls.tolist():
            self.simulator.add_obstacle([wall[:2], wall[2:]])
        self.simulator.process_obstacles()
        low, high = doors_along(hall.length)
        door = nearest_door(hall.length, hall.crowd.position[:, 1])
        self.low, self.high = low[door] + self.radius, high[door] - self.radius

    @property
    def inside(self) -> int:
        """Number of people, including those who have left the hall."""
        return int(self.simulator.get_num_agents())

    def positions(self) -> FloatArray:
        """Return the positions (n, 2) [m]."""
        places = map(self.simulator.get_agent_position, range(self.inside))
        return np.array([(place.x, place.y) for place in places])

    def advance(self) -> float:
        """Make the steps of a tick; return their CPU time without that of the preferred velocities [s]."""
        return sum(self._step() for _ in range(self.per_tick))

    def _step(self) -> float:
        for person, velocity in enumerate(self._preferred().tolist()):
            self.simulator.set_agent_pref_velocity(person, velocity)
        return cpu_time(self.simulator.do_step)

    def _preferred(self) -> FloatArray:
        """Return the preferred velocities (n, 2) [m/s]: to the nearest free place in the door, then straight on."""
        x, y = self.positions().T
        # The target is a radius behind the door line, so that people beside the door do not stop at the wall.
        towards = np.stack([np.maximum(self.depth - x, 0.0) + self.radius, np.clip(y, self.low, self.high) - y], axis=1)
        preferred: FloatArray = towards * (self.speed / np.hypot(*towards.T))[:, None]
        return preferred
