"""Maps of the step: against the relaxation time, the walking speed, the ratio of masses and of radii."""

from collections.abc import Callable, Iterator, Sequence
from functools import partial

import numpy as np

from evac.evidence import scenes
from evac.evidence.evidence import Evidence, Row
from evac.evidence.scenes import Scene
from evac.evidence.stability import trials
from evac.evidence.stability.maps import Cell, Curve, Mapped, show_map
from evac.evidence.stability.theory import lag_limit, step_limit, walk_lag
from evac.evidence.verdicts import reported

#: Steps over which the overlap is tabulated [s].
OVERLAP_STEPS = (0.1, 0.03, 0.01, 3e-3, 1e-3, 3e-4, 1e-4)

#: A lag behind the exact walk that counts as right [m].
SMALL_LAG = 0.01

ROOM = (0.0, 0.0, 6.0, 4.0)


def refusal(tau: float, explicit: bool = False) -> float:
    """Return the step [s] beyond which DEM refuses to start: that of a packing of equal bodies, omega^2 = 6 k / m."""
    return step_limit(np.sqrt(6.0 * trials.STIFFNESS / 80.0), tau, explicit)


def walk_against_wall(speed: float) -> Scene:
    """Return twelve people half a metre from a wall, walking towards it."""
    return scenes.people_in(ROOM, scenes.packed(12, 4, 0.2, 5.5, 1.0, 0.05), speed=speed)


def tau_cells(evidence: Evidence) -> Mapped:
    """Try the relaxation time against the step, for both drives, on a free walk whose exact path is known."""
    taus = 10.0 ** np.arange(-4.0, 1.1, 1.0 if evidence.quick else 0.5)
    steps = [0.01, 0.1] if evidence.quick else [1e-4, 3e-4, 1e-3, 3e-3, 0.01, 0.03, 0.1, 0.25, 0.5]
    bounds = (0.0, 0.0, 12.0, 4.0)
    speed, duration = 1.5, 5.0
    cells, curves = [], {}
    for variant in ("DEM", "NSM1 inertial", "NSM2 K_N = 1e5"):
        for drive, explicit in (("explicit", True), ("exponential", False)):
            panel = f"{variant}, {drive} drive"

            midpoint = variant.startswith("NSM2")
            for tau in taus:
                scene = scenes.people_in(bounds, [(1.0, 2.0)], speed=speed, tau=tau)

                def lag(trial: trials.Trial, tau: float = tau) -> float:
                    exact = 1.0 + speed * (trial.time + tau * np.expm1(-trial.time / tau))
                    return float(np.abs(trial.position[:, 0, 0] - exact).max())

                for step in steps:
                    trial = trials.attempt(
                        trials.make_model(variant), scene, step, duration, explicit=explicit, every=0.5
                    )
                    allowed = 1.01 * speed * walk_lag(tau, step, duration, explicit, midpoint)
                    cells.append(Cell(panel, tau, step, trials.judge(trial, lag, SMALL_LAG, allowed, "m")))
            curves[panel] = [
                Curve("explicit drive oscillates beyond h = tau", [1e-4, 1.0], [1e-4, 1.0]),
                Curve("explicit drive grows beyond h = 2 tau", [5e-5, 0.5], [1e-4, 1.0]),
            ][: 2 if explicit else 0]
            fine = np.geomspace(taus[0], taus[-1], 61)
            lags = [lag_limit(SMALL_LAG / speed, tau, duration, explicit, midpoint) for tau in fine]
            curves[panel].append(Curve("lag of 1 cm by theory", list(fine), lags))
            if variant == "DEM":
                limits = [refusal(tau, explicit) for tau in fine]
                curves[panel].append(Curve("limit of a packing, ω² = 6 k / m", list(fine), limits))
    return cells, curves


tau_map = partial(show_map, name="tau", compute=tau_cells, axes=("relaxation time tau [s]", "step h [s]"), columns=2)


def speed_cells(evidence: Evidence) -> Mapped:
    """Try the walking speed against the step, on people who walk against a wall."""
    speeds = [0.0, 1.5, 10.0] if evidence.quick else [0.0, 0.1, 0.5, 1.0, 1.5, 2.0, 3.0, 5.0, 7.0, 10.0]
    steps = [0.01, 0.1, 0.5] if evidence.quick else [1e-3, 3e-3, 0.01, 0.03, 0.1, 0.2, 0.5]
    cells = []
    for variant in trials.VARIANTS:
        for speed in speeds:
            cells += _overlap_cells(variant, speed, walk_against_wall(speed), steps, 3.0 if speed >= 0.5 else 8.0)
    fast = np.array([0.1, 10.0])
    curves = _of_nsm2(Curve("overlap h v / 2 of 2 mm", list(fast), list(2.0 * trials.SMALL_OVERLAP / fast)))
    impact = trials.SMALL_OVERLAP / np.sqrt(80.0 / trials.STIFFNESS)
    curves["DEM"] = [Curve("impact v sqrt(m / k) of 2 mm", [impact, impact], [1e-4, 1.0]), _packing_limit([0.05, 20.0])]
    return cells, curves


speed_map = partial(show_map, name="speed", compute=speed_cells, axes=("walking speed [m/s]", "step h [s]"))


def overlap_order(evidence: Evidence) -> list[str]:
    """Tabulate the greatest overlap against the step, with the power of h that it falls with."""
    rows = evidence.measured("overlap", lambda: _overlap_rows([0.1, 0.01] if evidence.quick else OVERLAP_STEPS))
    powers = ", ".join(f"{row['power of h']:.2f} ({row['model']})" for row in rows if row["model"].startswith("NSM2"))
    evidence.verdict(reported("NSM2: power of h of the overlap", powers, "1 (theory)", "Walking speed and step"))
    evidence.show("overlap_order", __name__, rows=rows)
    return []


def _overlap_rows(steps: Sequence[float]) -> Iterator[Row]:
    for variant in trials.VARIANTS:
        model = trials.make_model(variant)
        runs = [trials.attempt(model, walk_against_wall(1.5), step, 2.0, every=0.1) for step in steps]
        overlap = [np.nan if trial.message else trials.greatest_overlap(trial) for trial in runs]
        usable = np.isfinite(overlap) & (np.array(overlap) > 0.0)
        power = None
        if usable.sum() > 1:
            power = float(np.polyfit(np.log(np.array(steps)[usable]), np.log(np.array(overlap)[usable]), 1)[0])
        cells = {f"h = {step:g} s": f"{value:.2g}" for step, value in zip(steps, overlap, strict=True)}
        yield {"model": variant, **cells, "power of h": power}


def _ratio_cells(evidence: Evidence, ratios: Sequence[float], scene_of: Callable[[float], Scene]) -> list[Cell]:
    steps = [0.01] if evidence.quick else [1e-3, 0.01, 0.1]
    return [
        cell
        for variant in trials.VARIANTS
        for ratio in ratios
        for cell in _overlap_cells(variant, ratio, scene_of(ratio), steps, 2.0)
    ]


def _overlap_cells(variant: str, x: float, scene: Scene, steps: Sequence[float], duration: float) -> list[Cell]:
    runs = {step: trials.attempt(trials.make_model(variant), scene, step, duration) for step in steps}
    return [Cell(variant, x, step, trials.judge_overlap(variant, trial, step)) for step, trial in runs.items()]


def mass_cells(evidence: Evidence) -> Mapped:
    """Try the ratio of masses against the step, on a pack in which heavy and light take turns."""

    def pack(ratio: float) -> Scene:
        mass = 80.0 * np.sqrt(ratio) ** np.tile([-1.0, 1.0], 10)
        return scenes.people_in(ROOM, scenes.packed(20, 4, 0.2, 5.5, 1.0, 0.02), mass=mass, speed=1.5)

    ratios = [1.0, 1e3, 1e6] if evidence.quick else [1.0, 10.0, 1e2, 1e3, 1e4, 1e5, 1e6]
    limits = [step_limit(np.sqrt(6.0 * trials.STIFFNESS * np.sqrt(ratio) / 80.0), 0.5, False) for ratio in ratios]
    curves = {"DEM": [Curve("limit of a packing of the light ones", ratios, limits)]} | _half_paths(ratios)
    return _ratio_cells(evidence, ratios, pack), curves


mass_map = partial(show_map, name="mass_ratio", compute=mass_cells, axes=("ratio of masses", "step h [s]"))


def radius_cells(evidence: Evidence) -> Mapped:
    """Try the ratio of radii against the step, on a mixed crowd."""
    bounds = (0.0, 0.0, 4.0, 4.0)

    def mix(ratio: float) -> Scene:
        radius = np.geomspace(0.25, 0.25 / ratio, 30)
        places = scenes.scattered(30, bounds, radius, evidence.generator("radius", str(ratio)))
        return scenes.people_in(bounds, places, radius=radius, speed=1.5)

    ratios = [1.0, 100.0] if evidence.quick else [1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0]
    return _ratio_cells(evidence, ratios, mix), {"DEM": [_packing_limit(ratios)]} | _half_paths(ratios)


radius_map = partial(show_map, name="radius_ratio", compute=radius_cells, axes=("ratio of radii", "step h [s]"))


def _packing_limit(x: list[float]) -> Curve:
    """Return the step beyond which DEM refuses people of 80 kg with tau 0.5 s, for all x alike."""
    return Curve("limit of a packing, ω² = 6 k / m", x, [refusal(0.5)] * len(x))


def _half_paths(ratios: list[float]) -> dict[str, list[Curve]]:
    step = 2.0 * trials.SMALL_OVERLAP / 1.5
    return _of_nsm2(Curve("overlap h v / 2 of 2 mm", ratios, [step] * len(ratios)))


def _of_nsm2(curve: Curve) -> dict[str, list[Curve]]:
    return {variant: [curve] for variant in trials.VARIANTS if variant.startswith("NSM2")}
