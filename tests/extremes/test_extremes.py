"""Every extreme scene has an expected outcome with every contact model: never NaN, through a wall, or silent."""

import numpy as np
import pytest

from evac.evidence.scenes import Scene, one_direction, packed, room
from evac.evidence.stability_extremes import ROOM, extremes, try_extreme, try_triangle
from evac.evidence.stability_trial import (
    DEGRADED,
    HANDLED,
    REFUSED,
    RIGHT,
    VARIANTS,
    WRONG,
    attempt,
    greatest_overlap,
    judge,
    make_model,
)
from evac.physics.bundles import make_crowd

QUICK = extremes(quick=True)
FULL = extremes(quick=False)

DONE = {RIGHT, HANDLED}
NSM1 = {name for name in VARIANTS if name.startswith("NSM1")}

#: What may come of a scene: with NSM1, which removes overlaps; with the others.
EXPECTED = {
    "coincident centres": (DONE, {RIGHT, HANDLED, DEGRADED}),
    "half-overlapping start": (DONE, {RIGHT, HANDLED, DEGRADED}),
    "denser than discs can pack": ({DEGRADED}, {DEGRADED, REFUSED}),
    "400 people at a closed door": (DONE, DONE | {DEGRADED}),
    "door narrower than a body": (DONE, DONE),
    "squeezed between two walls": (DONE, DONE | {DEGRADED}),
    "UTM coordinates": (DONE, DONE),
    "UTM coordinates, touching": (DONE, DONE),
    "60 s against a wall": (DONE, DONE | {DEGRADED}),
}


def test_every_extreme_scene_has_an_expected_outcome():
    assert set(EXPECTED) == set(QUICK)


@pytest.mark.parametrize("variant", VARIANTS)
@pytest.mark.parametrize("name", QUICK)
def test_extreme_scene(name, variant):
    verdict = try_extreme(QUICK[name], variant)
    assert verdict.kind in EXPECTED[name][variant not in NSM1], verdict


@pytest.mark.slow
@pytest.mark.parametrize("variant", ["DEM", "NSM1 inertial", "NSM2 K_N = 1e5"])
@pytest.mark.parametrize("name", [name for name in FULL if name not in QUICK])
def test_large_or_long_extreme_scene(name, variant):
    verdict = try_extreme(FULL[name], variant)
    assert verdict.kind in ({RIGHT, HANDLED} if variant in NSM1 else {RIGHT, HANDLED, DEGRADED, REFUSED}), verdict


@pytest.mark.parametrize("model", ["dem", "nsm1", "nsm2"])
def test_building_of_one_triangle(model):
    verdict = try_triangle(model)
    assert verdict.kind == RIGHT, verdict


@pytest.mark.parametrize("variant", VARIANTS)
@pytest.mark.parametrize("gap", [0.0, 0.02])
def test_light_bodies_among_heavy_ones_stay_behind_walls(variant, gap):
    mass = np.tile([0.08, 8e4], 10)
    crowd = make_crowd(packed(20, 4, 0.2, 5.0, 1.0, gap), speed=1.5, mass=mass)
    trial = attempt(make_model(variant), Scene(ROOM, room(ROOM), one_direction(ROOM), crowd), 0.01, 5.0)
    assert trial.is_finite()
    assert trial.outside == 0


@pytest.mark.parametrize("step", [0.01, 0.1])
@pytest.mark.parametrize("ratio", [1e4, 1e6])
def test_nsm1_keeps_any_masses_apart(ratio, step):
    mass = 80.0 * np.sqrt(ratio) ** np.tile([-1.0, 1.0], 10)
    crowd = make_crowd(packed(20, 4, 0.2, 5.5, 1.0, 0.02), mass=mass, speed=1.5)
    trial = attempt(make_model("NSM1 inertial"), Scene(ROOM, room(ROOM), one_direction(ROOM), crowd), step, 2.0)
    assert greatest_overlap(trial) <= 1.001e-4


@pytest.mark.parametrize("variant", [name for name in VARIANTS if name != "NSM1 overdamped"])
def test_explicit_drive_beyond_twice_tau_is_refused_before_it_starts(variant):
    crowd = make_crowd([(1.0, 2.0)], speed=1.5, tau=1e-3)
    scene = Scene(ROOM, room(ROOM), one_direction(ROOM), crowd)
    trial = attempt(make_model(variant), scene, 0.01, 1.0, explicit=True)
    assert "tau" in trial.message
    assert len(trial.time) == 1


@pytest.mark.parametrize("variant", sorted(NSM1))
@pytest.mark.parametrize(
    ("step", "speed", "right"), [(0.01, 10.0, 3.0), (0.1, 10.0, 3.0), (0.5, 10.0, 3.0), (0.2, 7.0, 5.5)]
)
def test_nsm1_never_overlaps_beyond_its_tolerance(variant, step, speed, right):
    crowd = make_crowd(packed(12, 4, 0.2, right, 1.0, 0.05), speed=speed, tau=0.1)
    trial = attempt(make_model(variant), Scene(ROOM, room(ROOM), one_direction(ROOM), crowd), step, 3.0)
    assert trial.report["unconverged_steps"] == 0
    verdict = judge(trial, greatest_overlap, 1.001e-4, 1.001e-4, "m")
    assert verdict.kind in DONE, verdict
    assert verdict.kind != WRONG
