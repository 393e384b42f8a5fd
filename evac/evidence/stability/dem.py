"""DEM's limit of stability: stiffness against step on a pressed crowd, and the limit of contact networks."""

from collections.abc import Callable, Iterator
from functools import partial

import numpy as np

from evac.evidence import scenes
from evac.evidence.evidence import Evidence, Row
from evac.evidence.scenes import Scene
from evac.evidence.stability.maps import Cell, Curve, Mapped, show_map
from evac.evidence.stability.theory import greatest_frequency, step_limit, uncut_speed
from evac.evidence.stability.trials import Trial, Verdict, attempt, judge, make_model
from evac.evidence.verdicts import all_of
from evac.physics.scenes import room, towards
from evac.physics.state import make_crowd

DRIVES = {"explicit drive": True, "exponential drive": False}

#: Magnitude of random velocities given to a pressed crowd at rest, and greatest allowed growth of the perturbation.
NUDGE = 1e-6  # m/s
GROWTH = 100.0
STEPS = 400

#: Desired speed of the pressed crowds at tau = 0.5 s: little, so that even k = 1e3 holds them [m/s].
PRESS = 0.05


def crowd_in_corridor(number: int, rows: int, mass: float, tau: float = 0.5) -> Scene:
    """Return people in a triangular packing that fills a corridor's width, walking against its end."""
    bounds = (0.0, 0.0, 8.0, 0.2 * (2 * rows + 1))
    places = scenes.packed(number, rows, 0.2, 8.0, 0.0)
    return scenes.people_in(bounds, places, mass=mass, tau=tau, speed=PRESS * tau / 0.5)


def ring_around_big() -> Scene:
    """Return 40 small bodies pressing from all sides against a big one of the same mass."""
    bounds = (0.0, 0.0, 8.0, 8.0)
    angle = 2.0 * np.pi * np.arange(40) / 40
    ring = 4.0 + 2.1 * np.column_stack([np.cos(angle), np.sin(angle)])
    crowd = make_crowd(
        np.vstack([[(4.0, 4.0)], ring]),
        radius=np.array([2.0] + 40 * [0.1]),
        mass=60.0,
        speed=np.array([0.0] + 40 * [PRESS]),
    )
    return Scene(bounds, room(bounds), towards(bounds, (4.0, 4.0), 0.05), crowd)


def settled(scene: Scene, stiffness: float) -> Scene:
    """Return the scene pressed to rest, with unchanged load m v / tau and a tau that damps its slowest waves."""
    crowd = scene.crowd
    period = float(np.sqrt(crowd.mass.min() / stiffness))
    tau = 8.0 * period
    start = scene.changed(tau=np.full_like(crowd.tau, tau), speed=crowd.speed * (tau / crowd.tau)[:, None])
    step = 0.1 * period
    model = make_model("DEM", stiffness=stiffness)
    rest = attempt(model, start, step, 12_000 * step, every=6_000 * step, checked=False)
    return scene.changed(position=rest.position[-1])


def nudged(scene: Scene, generator: np.random.Generator) -> Scene:
    """Return the scene with small random velocities."""
    return scene.changed(velocity=NUDGE * generator.standard_normal(scene.crowd.position.shape))


def try_step(scene: Scene, stiffness: float, step: float, explicit: bool) -> Verdict:
    """Return the verdict on a nudged crowd after `STEPS` steps, beside the same crowd without the nudge."""
    plain = scene.changed(velocity=np.zeros_like(scene.crowd.velocity))
    model, span = make_model("DEM", stiffness=stiffness), STEPS * step
    trials = [attempt(model, start, step, span, explicit=explicit, every=span) for start in (scene, plain)]

    def growth(trial: Trial) -> float:
        return float(np.abs(trial.velocity[-1] - trials[1].velocity[-1]).max() / NUDGE)

    return judge(trials[0], growth, GROWTH, GROWTH, "times the nudge")


def stiffness_cells(evidence: Evidence) -> Mapped:
    """Try stiffness against step, with the limit of the pressed crowd's own network drawn in."""
    stiffnesses = 10.0 ** np.arange(3.0, 9.1, 3.0 if evidence.quick else 0.5)
    steps = 10.0 ** np.arange(-5.0, -0.9, 1.0 if evidence.quick else 0.25)
    cells = []
    limits: dict[str, list[float]] = {drive: [] for drive in DRIVES}
    for stiffness in stiffnesses:
        rest = settled(crowd_in_corridor(30, 5, 60.0), stiffness)
        frequency = greatest_frequency(rest, rest.crowd.position, stiffness)
        start = nudged(rest, evidence.generator("stiffness"))
        for drive, explicit in DRIVES.items():
            limits[drive].append(step_limit(frequency, 0.5, explicit))
            cells += [Cell(drive, stiffness, step, try_step(start, stiffness, step, explicit)) for step in steps]
    curves = {drive: [Curve("limit of the contact network", list(stiffnesses), limits[drive])] for drive in DRIVES}
    return sorted(cells, key=lambda cell: cell.panel), curves


stiffness_map = partial(
    show_map, name="dem_stiffness", compute=stiffness_cells, axes=("stiffness k [kg/s²]", "step h [s]"), columns=2
)

#: Heading of this section of the page.
SECTION = "DEM: stiffness and step"


def network_limits(evidence: Evidence) -> list[str]:
    """Tabulate the limit of several networks: theory, where a run divides steps, and onset of growth of a nudge."""
    rows = evidence.measured("dem_networks", _network_rows, evidence)
    safe = sum((row["a run cuts beyond [s]"] or np.inf) < row["limit by theory [s]"] for row in rows)
    evidence.verdict(all_of("DEM: steps of networks cut below the limit of theory", safe, len(rows), SECTION))
    evidence.show("network_limits", __name__, rows=rows, formats={key: ".5f" for key in rows[0] if key.endswith("[s]")})
    return []


def _network_rows(evidence: Evidence) -> Iterator[Row]:
    stiffness = 1.2e5
    cases = {
        "two people at a wall": scenes.people_in(
            (0.0, 0.0, 8.0, 4.0), [(7.8, 2.0), (7.4, 2.0)], mass=60.0, speed=PRESS
        ),
        "30 equal people packed": crowd_in_corridor(30, 5, 60.0),
        "the same, tau 0.01 s": crowd_in_corridor(30, 5, 60.0, tau=0.01),
        "40 small ones around a big one": ring_around_big(),
    }
    for name, scene in cases.items():
        rest = settled(scene, stiffness)
        frequency = greatest_frequency(rest, rest.crowd.position, stiffness)
        start = nudged(rest, evidence.generator("network"))
        for drive, explicit in DRIVES.items():
            yield {
                "network": name,
                "drive": drive,
                "omega_max² m / k": frequency**2 * 60.0 / stiffness,
                "limit by theory [s]": step_limit(frequency, float(scene.crowd.tau[0]), explicit),
                **_limits(start, stiffness, explicit),
            }


def _limits(nudged: Scene, stiffness: float, explicit: bool) -> dict[str, float | None]:
    """Return the steps beyond which the nudge grows in plain steps, and beyond which a run cuts its steps."""
    model = make_model("DEM", stiffness=stiffness)

    def is_whole(step: float) -> bool:
        trial = attempt(model, nudged, step, 10.0 * step, explicit=explicit, checked=False)
        return not trial.message and not trial.handling()

    return {
        "plain steps grow beyond [s]": _bisect(
            lambda step: uncut_speed(nudged, stiffness, step, explicit, STEPS) <= GROWTH * NUDGE
        ),
        "a run cuts beyond [s]": _bisect(is_whole),
    }


def _bisect(holds: Callable[[float], bool]) -> float | None:
    """Return the step [s] between 1e-4 and 0.1 at which `holds` turns false, None if it does not."""
    low, high = 1e-4, 0.1
    if holds(high):
        return None
    for _ in range(12):
        middle = float(np.sqrt(low * high))
        low, high = (middle, high) if holds(middle) else (low, middle)
    return low
