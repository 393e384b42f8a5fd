"""JuPedSim, from the package jupedsim."""

import shapely

from evac.evidence.scaling.halls import DOOR, Hall, doors_along, nearest_door
from evac.evidence.scaling.walks import TICK, cpu_time

#: Depth of the ground outside the doors, on which the exits are [m].
OUTSIDE = 2.0


class JupedsimWalk:
    """A model of JuPedSim, by the name of its class; everybody walks to the nearest door."""

    def __init__(self, hall: Hall, step: float, model: str) -> None:
        import jupedsim

        self.per_tick = round(TICK / step)
        low, high = doors_along(hall.length)
        ends = list(zip(low, high, strict=True))
        grounds = [shapely.box(hall.depth - 0.01, start, hall.depth + OUTSIDE, end) for start, end in ends]
        area = shapely.union_all([shapely.box(0.0, 0.0, hall.depth, hall.length), *grounds])
        self.simulation = jupedsim.Simulation(model=getattr(jupedsim, model)(), geometry=area, dt=step)
        stages = [
            self.simulation.add_exit_stage(shapely.box(hall.depth + 0.5 * DOOR, start, hall.depth + OUTSIDE, end))
            for start, end in ends
        ]
        journeys = [self.simulation.add_journey(jupedsim.JourneyDescription([stage])) for stage in stages]
        parameters, crowd = getattr(jupedsim, f"{model}AgentParameters"), hall.crowd
        doors = nearest_door(hall.length, crowd.position[:, 1])
        for place, radius, speed, door in zip(crowd.position, crowd.radius, crowd.speed[:, 0], doors, strict=True):
            self.simulation.add_agent(
                parameters(
                    position=(float(place[0]), float(place[1])),
                    radius=float(radius),
                    desired_speed=float(speed),
                    journey_id=journeys[door],
                    stage_id=stages[door],
                )
            )

    @property
    def inside(self) -> int:
        """Number of people who have not reached an exit."""
        return int(self.simulation.agent_count())

    def advance(self) -> float:
        """Make the steps of a tick; return their CPU time [s]."""
        return cpu_time(lambda: self.simulation.iterate(self.per_tick))
