"""The narrowest door with which a room is left in time: a root of the mean of runs with the same seeds."""

from scipy.optimize import brentq

import evac

REQUIRED, RUNS = 14.0, 3  # time [s], and runs for each width


def room(width):
    """Return a room with a door of a width [m]."""
    plan = evac.Plan()
    plan.storey("room", [(0, 0), (8, 0), (8, 6), (0, 6)])
    plan.exit("door", "room", [(0, 3 - width / 2), (0, 3 + width / 2)])
    plan.area("seats", "room", [(2, 0.5), (7.5, 0.5), (7.5, 5.5), (2, 5.5)])
    people = [{"name": "guests", "area": "seats", "number": 30}]
    return evac.load({"building": plan, "people": people, "contact": {"model": "nsm2"}, "behaviours": {"walking": {}}})


def excess(width):
    """Return by how much the mean evacuation time exceeds the required one [s]."""
    mean = evac.repeat(room(width), RUNS, workers=1).statistics[0].mean.value
    print(f"{width:.3f} m: {mean:.1f} s")
    return mean - REQUIRED


if __name__ == "__main__":
    print(f"narrowest door: {brentq(excess, 0.9, 2.4, xtol=0.05):.2f} m")
