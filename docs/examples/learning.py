"""A learner that closes doors: Q-learning of which exit to close in each interval, with the time of all as the cost."""

import sys

import numpy as np

import evac

EVERY, SLOTS = 3.0, 6  # time between two decisions [s], and their number, after which the last one holds
ACTIONS = ((), ("left",), ("right",))  # exits that are closed until the next decision


def hall():
    """Return a hall with two exits, of which the nearer one is narrow."""
    plan = evac.Plan()
    plan.storey("hall", [(0, 0), (12, 0), (12, 5), (0, 5)])
    plan.exit("left", "hall", [(0, 2), (0, 2.9)])
    plan.exit("right", "hall", [(12, 1), (12, 4)])
    plan.area("start", "hall", [(1, 0.5), (6, 0.5), (6, 4.5), (1, 4.5)])
    people = [{"name": "people", "area": "start", "number": 40}]
    return evac.load({"building": plan, "people": people, "contact": {"model": "nsm2"}, "behaviours": {"walking": {}}})


def episode(case, cost):
    """Make a run, choosing what costs least as far as is known, and learn from it; return when all are out."""
    simulation = evac.Simulation(case)
    while not simulation.ended:
        slot = min(int(simulation.time / EVERY + 1e-9), SLOTS - 1)
        action, begin = int(cost[slot].argmin()), simulation.time
        for name in ("left", "right"):
            kind = "close" if name in ACTIONS[action] else "open"
            simulation.scene.apply(evac.Change(simulation.time, kind, name))
        while not simulation.ended and simulation.time < begin + EVERY - 1e-9:
            simulation.advance_tick()
        ahead = 0.0 if simulation.ended else cost[min(slot + 1, SLOTS - 1)].min()
        cost[slot, action] += 0.5 * (simulation.time - begin + ahead - cost[slot, action])
    return simulation.time


if __name__ == "__main__":
    episodes = int(sys.argv[1]) if len(sys.argv) > 1 else 15
    own, table = hall(), np.zeros((SLOTS, len(ACTIONS)))  # nothing costs anything yet, so that all is tried
    times = [episode(own, table) for _ in range(episodes)]
    print(" ".join(f"{time:.1f}" for time in times))
    print(f"best {min(times):.1f} s, left alone {evac.run(own).time:.1f} s")
