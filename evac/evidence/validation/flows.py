"""Tests of crowds against published flows and densities: corridors, bottlenecks, a stair's foot, counterflow."""

import itertools
from collections.abc import Sequence

import numpy as np

from evac.analysis.flows import steady_flow
from evac.base.arrays import FloatArray
from evac.evidence.validation.buildings import CROWD_SPEED, Face, across, rectangle, straight_stair, two_rooms
from evac.evidence.validation.trial import Check, Criterion, Outcome, Trial

#: Densities of the fundamental diagram [1/m2]; bodies of the greatest radius do not fit at RiMEA's 5 and 6.
DENSITIES = (0.5, 1.0, 2.0, 3.0)

#: Accepted deviation from Weidmann's curve: one standard deviation of the free speed, 0.26 of 1.34 m/s.
WEIDMANN_BAND = 0.26 / 1.34

#: The corridor: filled from x1 to x2, seen in [x1, x2] from t1 to t2, free at its end; nothing from its ends arrives.
FILLED = (2.0, 82.0)  # m
SEEN = (58.0, 62.0)  # m
SEEN_FROM, SEEN_UNTIL = 10.0, 40.0  # s

#: Greatest flow per metre up a stair: IMO's and the greatest of SFPE's values by tread [1/s/m].
STAIR_FLOW = (0.88, 1.16)

COUNTER = (0, 10, 50, 100)


def weidmann(density: float) -> float:
    """Return the walking speed of Weidmann's fundamental diagram (1993) at a density [1/m2] in m/s."""
    return float(1.34 * (1.0 - np.exp(-1.913 * (1.0 / density - 1.0 / 5.4))))


def fundamental_diagram(trial: Trial) -> list[Check]:
    """RiMEA 4: speed over density in a corridor so long that its ends are not felt where people are seen."""
    checks = []
    for density in DENSITIES:
        group = {
            "area": "filled",
            "number": round(2.0 * (FILLED[1] - FILLED[0]) * density),
            "speed": {"uniform": [1.2, 1.4]},
        }
        runs = trial.runs(
            [rectangle(0, 0, 100, 2)],
            [("end", across(100, 0, 2), 0.0)],
            [group],
            [("filled", (FILLED[0], 0, FILLED[1], 2), 0.0)],
            **{"simulation.duration": SEEN_UNTIL},
        )
        criterion = Criterion(
            "RiMEA 4",
            f"speed over Weidmann's at the density found, corridor filled with {density:g} /m²",
            "Weidmann (1993) ± one standard deviation of the free speed",
            low=1.0 - WEIDMANN_BAND,
            high=1.0 + WEIDMANN_BAND,
        )
        checks.append(trial.check(criterion, [_over_weidmann(outcome) for outcome in runs]))
    return checks


def _over_weidmann(outcome: Outcome) -> float:
    """Return the mean speed in the measuring field over Weidmann's at the mean density there."""
    found = outcome.trajectory
    x, speed = found.position[..., 0], found.velocity[..., 0]
    seen = (x >= SEEN[0]) & (x < SEEN[1]) & (found.time >= SEEN_FROM)[:, None]
    frames = int((found.time >= SEEN_FROM).sum())
    density = float(seen.sum()) / frames / (2.0 * (SEEN[1] - SEEN[0]))
    return float(speed[seen].mean()) / weidmann(density)


def wider_bottlenecks(trial: Trial) -> list[Check]:
    """RiMEA 12d: the flow through a bottleneck grows with its width."""
    flows = np.array([_bottleneck_flows(trial, width) for width in (0.8, 1.0, 1.2)])
    criterion = Criterion(
        "RiMEA 12d", "flow at 1.0 over 0.8 m, or 1.2 over 1.0 m width, the lesser", "RiMEA, annex 1", low=1.0
    )
    return [trial.check(criterion, (flows[1:] / flows[:-1]).min(axis=0))]


def _bottleneck_flows(trial: Trial, width: float) -> list[float]:
    """Return the steady flow of 150 people out of two rooms with a bottleneck between, a run each [1/s]."""
    faces, _ = two_rooms(width, 0.2, 10.0)
    crowd = {"area": "start", "number": 150, "speed": CROWD_SPEED}
    way_out = ("end", across(20.2, 0, 10), 0.0)
    runs = trial.runs(faces, [way_out], [crowd], [("start", (0, 0, 5, 10), 0.0)])
    return [float("nan") if outcome.is_blocked else steady_flow(outcome.exit_times) for outcome in runs]


def foot_of_a_stair(trial: Trial) -> list[Check]:
    """RiMEA 13 and IMO 11: 150 people through a corridor up a stair that cannot take what the corridor brings."""
    faces = [rectangle(0, 0, 5, 8), rectangle(5, 3, 17, 5), *_moved(straight_stair(3.0, 1.0, 2.0, 3.0)[1:], 17.0, 3.0)]
    crowd = {
        "area": "room",
        "number": 150,
        "speed": {"uniform": [1.26, 1.34]},
        "speed_up": {"uniform": [0.635, 0.715]},
    }
    gains, flows = [], []
    for outcome in trial.runs(
        faces,
        [("end", across(23, 3, 5), 1.0)],
        [crowd],
        [("room", (0, 0, 5, 8), 0.0)],
        **{"output.every": 0.1},
    ):
        entered, foot = (passing_times(outcome, x) for x in (5.0, 17.0))
        flow = float("nan") if outcome.is_blocked else steady_flow(foot)
        gains.append(steady_flow(entered) / flow)
        flows.append(flow / 2.0)
    return [
        trial.check(
            Criterion(
                "RiMEA 13, IMO 11",
                "flow into the corridor over the flow onto the stair: jam at its foot",
                "RiMEA, annex 1; IMO",
                low=1.0,
            ),
            gains,
        ),
        trial.check(
            Criterion("RiMEA 13, IMO 11", "flow up the stair [1/s/m]", "IMO, SFPE", *STAIR_FLOW),
            flows,
        ),
    ]


def _moved(faces: Sequence[Face], x: float, y: float) -> list[Face]:
    """Return faces moved in plan [m]."""
    return [[(px + x, py + y, pz) for px, py, pz in face] for face in faces]


def passing_times(outcome: Outcome, x: float) -> FloatArray:
    """Return when each person is first seen beyond `x`, or out, in ascending order [s]."""
    place = outcome.trajectory.position[..., 0]
    beyond = np.isnan(place) | (place > x)
    return np.sort(outcome.trajectory.time[beyond.argmax(axis=0)][beyond.any(axis=0)])


def counterflow(trial: Trial) -> list[Check]:
    """IMO 8 and NIST 2.8: the more people come the other way, the later the last one arrives."""
    faces = [rectangle(0, 0, 10, 10), rectangle(10, 4, 20, 6), rectangle(20, 0, 30, 10)]
    exits = [("right", across(30, 0, 10), 0.0), ("left", across(0, 0, 10), 0.0)]
    areas = [("A", (0.5, 0, 10, 10), 0.0), ("B", (20, 0, 29.5, 10), 0.0)]
    first = {"area": "A", "number": 100, "speed": CROWD_SPEED, "exits": ["right"]}
    times = []
    for number in COUNTER:
        other = [{"area": "B", "number": number, "speed": CROWD_SPEED, "exits": ["left"]}] if number else []
        runs = trial.runs(faces, exits, [first, *other], areas)
        times.append([outcome.last_out for outcome in runs])
    last = np.array(times)
    return [
        trial.check(
            Criterion(
                "IMO 8, NIST 2.8",
                f"last arrival of 100 people against {more} over against {fewer}",
                "IMO, NIST TN 1822",
                low=1.0,
            ),
            last[k + 1] / last[k],
        )
        for k, (fewer, more) in enumerate(itertools.pairwise(COUNTER))
    ]
