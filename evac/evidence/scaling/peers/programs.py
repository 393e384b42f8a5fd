"""The programs that are compared: evac, JuPedSim, ORCA by the library RVO2, and cromosim, each from its package."""

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import shapely
from matplotlib.lines import Line2D

from evac.base.arrays import FloatArray
from evac.evidence.scaling.halls import DOOR, SPEED, Hall, doors_along, nearest_door
from evac.evidence.scaling.minimal import make_minimal, walk_minimal
from evac.evidence.scaling.walks import TICK, Walk, cpu_time
from evac.evidence.scenes import plugins
from evac.people.behaviour import BehaviourScene
from evac.people.outside import make_outside
from evac.physics.contact.model import ContactModel
from evac.simulation.scene import SharedScene


class EvacWalk:
    """A contact model of evac."""

    def __init__(self, hall: Hall, step: float, model: ContactModel) -> None:
        self.walk, self.model = Walk(hall, step), model

    @property
    def inside(self) -> int:
        """Number of people in the hall."""
        return self.walk.inside

    def advance(self) -> float:
        """Make the steps of a tick; return their CPU time [s]."""
        return cpu_time(lambda: self.walk.advance(self.model))


class MinimalWalk:
    """The minimal kernel: DEM without walls."""

    def __init__(self, hall: Hall, step: float) -> None:
        self.minimal = make_minimal(hall.crowd, hall.fields.packed, step)
        self.step = step
        self.inside = len(self.minimal.radius)

    def advance(self) -> float:
        """Make the steps of a tick; return their CPU time [s]."""
        return cpu_time(lambda: walk_minimal(self.minimal, round(TICK / self.step), self.step))


class BehaviourWalk(EvacWalk):
    """A contact model of evac with a behaviour that keeps distances, which acts at the start of every tick."""

    def __init__(self, hall: Hall, step: float, model: ContactModel, behaviour: str = "headway") -> None:
        super().__init__(hall, step, model)
        crowd = self.walk.crowd
        self.behaviour = plugins().get("behaviour", behaviour)()
        crowd.contact_radius[:] = self.behaviour.contact_radius(crowd.radius, {})
        scene: Any = SharedScene(hall.building, hall.fields)  # nothing changes
        self.moved, outside = np.zeros((len(crowd.level), 2)), make_outside(len(crowd.level))
        self.behaviour.prepare(
            BehaviourScene(crowd, scene, (), np.random.default_rng(0), TICK, outside, displacement_velocity=self.moved)
        )

    def advance(self) -> float:
        """Let the behaviour act and make the steps of a tick; return the CPU time of both [s]."""
        return cpu_time(self.act) + cpu_time(self.step)

    def act(self) -> None:
        """Let the behaviour decide."""
        crowd = self.walk.crowd
        crowd.speed_factor[:] = 1.0
        crowd.extra_direction[:] = 0.0
        self.behaviour.act(crowd, self.walk.time)

    def step(self) -> None:
        """Make the steps of a tick."""
        before = self.walk.crowd.position.copy()
        self.walk.advance(self.model)
        np.divide(self.walk.crowd.position - before, TICK, out=self.moved)


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
        x, y = self.positions().T
        # The target is a radius behind the door line, so that people beside the door do not stop at the wall.
        towards = np.stack([np.maximum(self.depth - x, 0.0) + self.radius, np.clip(y, self.low, self.high) - y], axis=1)
        preferred: FloatArray = towards * (self.speed / np.hypot(*towards.T))[:, None]
        return preferred


#: Side of a pixel, as in the examples of cromosim, and width of the ground around the hall [m].
PIXEL, MARGIN = 0.1, 1.0

WALL, DESTINATION = [0, 0, 0], [255, 0, 0]  # colours


class CromosimWalk:
    """The granular model of cromosim, solved by cvxopt: velocities are projected so that nobody overlaps.

    The desired velocities are projected (Maury and Venel), or with `is_inertial` velocities that approach the desired
    ones within tau, as those of NSM1 do. cromosim has no masses: everybody has the same one.
    """

    def __init__(self, hall: Hall, step: float, is_inertial: bool) -> None:
        crowd = hall.crowd
        self.step, self.per_tick = step, round(TICK / step)
        self.domain, self.exit = _domain(hall), hall.depth + MARGIN
        share = -np.expm1(-step / crowd.tau) if is_inertial else np.ones(len(crowd.tau))
        self.people = {
            "xyrv": np.column_stack([crowd.position + MARGIN, crowd.radius, crowd.speed[:, 0]]),
            "U": np.zeros_like(crowd.position),
            "approached": share[:, None],  # share of the gap to the desired velocity that a step closes
        }

    @property
    def inside(self) -> int:
        """Number of people in the hall."""
        return len(self.people["xyrv"])

    def positions(self) -> FloatArray:
        """Return the positions of those who are inside (n, 2) [m]."""
        return self.people["xyrv"][:, :2] - MARGIN

    def advance(self) -> float:
        """Make the steps of a tick; return their CPU time [s]."""
        return sum(cpu_time(self._step) for _ in range(self.per_tick))

    def _step(self) -> None:
        from cromosim import micro

        people, places = self.people, self.people["xyrv"]
        _, _, desired = self.domain.people_desired_velocity(places, ["doors"] * len(places))
        # Nobody who is farther away can be reached in one step.
        contacts = micro.compute_contacts(self.domain, places, 2.0 * SPEED[1] * self.step)
        free = people["U"] + people["approached"] * (desired - people["U"])
        people["U"] = micro.projection(self.step, places, contacts, free)[2]
        micro.move_people(0.0, self.step, people, {})
        is_inside = places[:, 0] < self.exit
        self.people = {name: values[is_inside] for name, values in people.items()}


def _domain(hall: Hall) -> Any:
    """Return a domain of cromosim: the walls, and the line between the posts of each door as the destination."""
    from cromosim import Destination, Domain

    width, height = (round((side + 2.0 * MARGIN) / PIXEL) for side in (hall.depth, hall.length))
    with TemporaryDirectory() as folder:  # a picture of the domain is written to the path in its name
        domain = Domain(name=str(Path(folder) / "hall"), pixel_size=PIXEL, width=width, height=height)
        doors = [[hall.depth, low, hall.depth, high] for low, high in zip(*doors_along(hall.length), strict=True)]
        for lines, colour in ((doors, DESTINATION), (hall.building.walls.tolist(), WALL)):
            for line in np.array(lines) + MARGIN:
                domain.add_shape(Line2D(line[::2], line[1::2], linewidth=1), outline_color=colour, fill_color=colour)
        domain.build_domain()
    domain.add_destination(Destination(name="doors", colors=[DESTINATION], excluded_colors=[WALL]))
    return domain
