"""NSM2 over its whole range of dissipation, standing crowds, static overlaps and forces."""

from collections.abc import Iterator, Sequence
from functools import partial
from typing import Any

import numpy as np

from evac.base.arrays import FloatArray
from evac.base.errors import EvacError
from evac.evidence import scenes
from evac.evidence.evidence import Evidence, Row, new_figure
from evac.evidence.scenes import Scene, plugins
from evac.evidence.stability import trials
from evac.evidence.stability.maps import Cell, cell_rows
from evac.evidence.verdicts import all_of, at_most, reported
from evac.physics.contact.model import ContactModel

#: Greatest speed of a crowd that stands [m/s].
STANDS = 0.005

#: Error of velocities that counts as correct: twice the solvers' tolerance [m/s].
SMALL_SPEED = 1e-3

#: How fast the standing crowd wants to walk, tau = 0.5 s [m/s].
WALKING = 1.5

#: Columns of the standing crowd, from the wall back.
COLUMNS = 8

ROOM = (0.0, 0.0, 6.0, 4.0)

#: Columns of the table of standing crowds.
STANDING_AXES = ("step h [s]", "bound [m/s]")


def dissipation(evidence: Evidence) -> list[str]:
    """Try NSM2 at K_N from 0 to infinity with each solver: restitution, and bodies squeezed between walls."""
    rows = evidence.measured("dissipation", _dissipation_rows, evidence.quick)
    section = "NSM2: dissipation from zero to infinity"
    off = max(abs(row[f"{name}: restitution"] - row[f"{name}: theory"]) for row in rows for name in ("pair", "wall"))
    evidence.verdict(at_most("NSM2: greatest error of the coefficient of restitution", off, SMALL_SPEED, "", section))
    evidence.show("dissipation", __name__, rows=rows)
    return []


def _dissipation_rows(quick: bool) -> Iterator[Row]:
    values = [0.0, 1e2, 1e5, np.inf] if quick else [0.0, *10.0 ** np.arange(0.0, 9.1), np.inf]
    # without driving force: they keep their velocity until they touch
    pair = scenes.people_in(ROOM, [(2.5, 2.0), (2.92, 2.0)], [(1.5, 0.0), (-1.0, 0.0)], tau=1e12, mass=[60.0, 100.0])
    wall = scenes.people_in(ROOM, [(5.7, 2.0)], [(1.5, 0.0)], tau=1e12, mass=80.0)
    for value in values:
        for solver in plugins().solvers:
            model = trials.make_model("NSM2 K_N = 1e5", normal_dissipation=value, solver=solver)
            row: dict[str, Any] = {"K_N [kg]": value, "solver": solver}
            for name, scene, mass in (("pair", pair, 60.0 * 100.0 / 160.0), ("wall", wall, 80.0)):
                trial = trials.attempt(model, scene, 0.01, 0.3, every=0.01)
                expected = restitution(value, mass)
                row |= {f"{name}: restitution": _rebound(trial), f"{name}: theory": expected}
                row[name] = trials.judge(trial, partial(_off, expected), SMALL_SPEED, SMALL_SPEED, "").kind
            yield row | _try_squeeze(model)


def restitution(dissipation: float, mass: float) -> float:
    """Return NSM2's coefficient of restitution, (K_N / 2 - m) / (K_N / 2 + m) and 0 below K_N = 2 m."""
    if np.isinf(dissipation):
        return 1.0
    return max(0.0, (0.5 * dissipation - mass) / (0.5 * dissipation + mass))


def squeeze() -> Scene:
    """Return five people who overlap each other and both walls of a corridor, moving to and fro."""
    bounds = (0.0, 0.0, 1.9, 1.0)
    line = np.column_stack([np.linspace(0.18, 1.72, 5), np.full(5, 0.5)])
    return scenes.people_in(bounds, line, [(0.1 * (-1.0) ** k, 0.0) for k in range(5)], speed=2.0, mass=80.0)


def _try_squeeze(model: ContactModel) -> Row:
    scene = squeeze()
    start = trials.deepest_overlap(scene, scene.crowd.position)
    engine, crowd = scene.start()
    engine.advance(model, crowd, 0, 1, 0.01, False, False)
    percussion = float(engine.data.contacts.percussion[: engine.data.contacts.number].max())
    trial = trials.attempt(model, scene, 0.01, 2.0)
    verdict = trials.judge(
        trial, lambda _: max(0.0, trials.greatest_overlap(trial) - start), 2e-3, 0.02, "m", is_reported=True
    )
    return {
        "squeeze: percussion [N s]": percussion,
        "squeeze: fallbacks": int(trial.report["elastic_fallbacks"]),
        "squeeze: force at the end [N]": float(trial.crowd.contact_force.max()),
        "squeeze: overlap more [m]": verdict.error,
        "squeeze": verdict.kind,
    }


def _rebound(trial: trials.Trial) -> float:
    other = trial.velocity[[0, -1], 1, 0] if trial.velocity.shape[1] > 1 else 0.0
    relative = trial.velocity[[0, -1], 0, 0] - other
    return float(-relative[1] / relative[0])


def _off(expected: float, trial: trials.Trial) -> float:
    return abs(_rebound(trial) - expected)


def _draw_restitution(rows: Sequence[Row]) -> Any:
    figure, axis = new_figure(6.5, 4.0)
    smooth = np.logspace(-0.5, 10.0, 400)
    finite = [row for row in rows if 0.0 < row["K_N [kg]"] < np.inf]
    for name, mass, colour in (("pair", 37.5, "#0072B2"), ("wall", 80.0, "#D55E00")):
        axis.plot(smooth, [restitution(k, mass) for k in smooth], color=colour, label=f"{name}, {mass:g} kg: theory")
        values = [row[f"{name}: restitution"] for row in finite]
        axis.plot([row["K_N [kg]"] for row in finite], values, "o", color=colour, label=f"{name}: measured")
    axis.set(xscale="log", xlabel="K_N [kg]", ylabel="coefficient of restitution")
    axis.legend(fontsize=8)
    return figure


def standing_crowd() -> Scene:
    """Return 40 people, 2 cm apart, who fill the width of a corridor and walk against its end."""
    bounds = (0.0, 0.0, 6.0, 2.2)
    places = scenes.packed(5 * COLUMNS, 5, 0.2, 5.99, 0.0, 0.0)
    places[:, 0] -= 0.02 * np.arange(5 * COLUMNS) // 5
    return scenes.people_in(bounds, places, speed=WALKING)


def standing(evidence: Evidence) -> list[str]:
    """Tabulate the greatest speed of 40 people pressed against a wall, for all models, solvers, drives and steps."""
    cells = evidence.measured("standing_cells", lambda: cell_rows(_standing_cells(evidence.quick), STANDING_AXES))
    section = "Standing crowds"
    rows: dict[str, dict[str, Any]] = {}
    still: dict[str, list[bool]] = {}
    for cell in cells:
        variant, solver, drive = cell["panel"].split(", ")
        row = rows.setdefault(cell["panel"], {"model": variant, "solver": solver or "-", "drive": drive})
        speed = cell["error"]
        row[f"h = {cell[STANDING_AXES[0]]:g} s"] = f"{speed:.2g}" if np.isfinite(speed) else cell["verdict"]
        if cell["verdict"] != trials.REFUSED:
            still.setdefault(variant, []).append(speed <= STANDS)
    for variant, stands in still.items():
        evidence.verdict(all_of(f"{variant}: runs in which a standing crowd stands", sum(stands), len(stands), section))
    evidence.show("standing", __name__, rows=list(rows.values()), cells=cells)
    return [cell["verdict"] for cell in cells]


def _standing_cells(quick: bool) -> list[Cell]:
    default = trials.make_model("NSM1 inertial").values()["solver"]
    return [
        Cell(f"{variant}, {solver}, {drive}", step, STANDS, try_standing(variant, solver, drive == "explicit", step))
        for variant in trials.VARIANTS
        for solver in (("",) if variant == "DEM" else plugins().solvers)
        for drive in ("exponential", "explicit")
        if not quick or (drive == "exponential" and solver in ("", default))
        for step in ([0.1, 0.01] if quick else [0.1, 0.03, 0.01, 1e-3, 1e-4])
    ]


def try_standing(variant: str, solver: str, explicit: bool, step: float) -> trials.Verdict:
    """Return the verdict on the greatest speed of the standing crowd in the last second."""
    model = trials.make_model(variant, **({"solver": solver} if solver else {}))
    scene, duration = standing_crowd(), 10.0
    if step < 5e-4:
        before = trials.attempt(model, scene, 1e-3, duration, explicit=explicit, every=duration)
        scene, duration = scene.changed(position=before.position[-1], velocity=before.velocity[-1]), 2.0
    trial = trials.attempt(model, scene, step, duration, explicit=explicit)
    return trials.judge(trial, trials.last_speed, STANDS, tolerable_jitter(variant, step), "m/s")


def tolerable_jitter(variant: str, step: float) -> float:
    """Return the speed [m/s] at which a standing crowd may jitter by the model's theory.

    Solvers leave at most their tolerance at each contact, which adds up over the columns of the crowd. NSM2 detects
    only after a step that the drive closed a gap: h v / tau at K_N = 0; with restitution each push is returned, up to
    the walking speed. DEM has neither.
    """
    if variant == "DEM":
        return STANDS
    left = float(trials.make_model(variant).values()["velocity_tolerance"]) * COLUMNS
    if not variant.startswith("NSM2"):
        return left
    return left + step * WALKING / 0.5 if variant == "NSM2 K_N = 0" else WALKING


def static_overlap(evidence: Evidence) -> list[str]:
    """Tabulate the overlap of one person pressed against a wall under DEM, beside F / k."""
    rows = evidence.measured("static_overlap", _static_rows)
    text = f"{max(row['error'] for row in rows):.1g}"
    evidence.verdict(reported("DEM: static overlap, relative error", text, "0 (theory)", "DEM: stiffness and step"))
    evidence.show("static_overlap", __name__, rows=rows)
    return []


def _static_rows() -> Iterator[Row]:
    tau = 0.1
    cases = [
        (stiffness, speed, 0.1 * float(np.sqrt(80.0 / stiffness)), drive)
        for stiffness in (1e4, 1.2e5, 1e6)
        for speed in (1.0, 2.0)
        for drive in ("explicit", "exponential")
    ]
    cases += [(1.2e5, 2.0, 0.01, drive) for drive in ("explicit", "exponential")]
    for stiffness, speed, step, drive in cases:
        scene = scenes.people_in(ROOM, [(5.8, 2.0)], tau=tau, speed=speed)
        trial = trials.attempt(
            trials.make_model("DEM", stiffness=stiffness), scene, step, 4.0, explicit=drive == "explicit"
        )
        load = 80.0 * speed / tau
        share = 1.0 if drive == "explicit" else -float(np.expm1(-step / tau)) * tau / step
        yield {
            "k [kg/s²]": stiffness,
            "load F = m v / tau [N]": load,
            "h [s]": step,
            "drive": drive,
            "overlap [m]": trials.last_overlap(trial),
            "F / k [m]": load / stiffness,
            "overlap over F / k": trials.last_overlap(trial) * stiffness / load,
            "theory": share,
            "error": abs(trials.last_overlap(trial) * stiffness / (load * share) - 1.0),
        }


def reported_force(evidence: Evidence) -> list[str]:
    """Tabulate the contact force reported for a person in a pressed row, over the steps, beside the load's."""
    rows = evidence.measured("reported_force", _force_rows, evidence.quick)
    evidence.show("reported_force", __name__, rows=rows)
    return []


def _force_rows(quick: bool) -> Iterator[Row]:
    steps = [0.01] if quick else [0.1, 0.01, 1e-3, 1e-4]
    for variant in trials.VARIANTS:
        if variant == "NSM1 overdamped":
            continue  # knows no forces
        for drive in ("explicit", "exponential"):
            row: dict[str, Any] = {"model": variant, "drive": drive}
            for step in steps:
                forces = pressed_forces(variant, step, drive == "explicit")
                text = "refused" if forces is None else f"{forces.mean():.4f} +- {forces.std():.2g}"
                row[f"h = {step:g} s"] = text
            share = 1.0 if drive == "explicit" else -float(np.expm1(-0.01 / 0.5)) * 0.5 / 0.01
            yield row | {"theory, h = 0.01 s": share}


def pressed_forces(variant: str, step: float, explicit: bool) -> FloatArray | None:
    """Return the contact force at the wall over 9 m v / tau, at 100 moments; None if the model refuses the step."""
    bounds = (0.0, 0.0, 6.0, 1.0)
    places = [(5.8 - 0.4 * k, 0.5) for k in range(5)]
    scene = scenes.people_in(bounds, places, speed=WALKING)
    model = trials.make_model(variant)
    engine, crowd = scene.start()
    try:
        model.check_scene(scene.border(step, explicit))
    except EvacError:
        return None
    every = max(1, round(0.01 / step))
    first = round(2.0 / step)
    engine.advance(model, crowd, 0, first, step, explicit, False)
    forces = np.empty(100)
    for k in range(len(forces)):
        engine.advance(model, crowd, first + k * every, every, step, explicit, True)
        forces[k] = crowd.contact_force[0]
    return np.asarray(forces / (9.0 * 80.0 * WALKING / 0.5))
