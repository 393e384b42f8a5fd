"""cromosim, from the package of that name: its granular model, and the same with inertia."""

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from matplotlib.lines import Line2D

from evac.base.arrays import FloatArray
from evac.evidence.scaling.halls import SPEED, Hall, doors_along
from evac.evidence.scaling.walks import TICK, cpu_time

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
