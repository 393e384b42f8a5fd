"""Every extreme scene has an expected outcome with every contact model: never NaN, through a wall, or silent."""

import numpy as np
import pytest

from evac.evidence.scenes import Scene, packed
from evac.evidence.stability.extremes import ROOM, extremes, try_extreme, try_triangle
from evac.evidence.stability.trials import (
    BEYOND,
    DEGRADED,
    HANDLED,
    REFUSED,
    RIGHT,
    VARIANTS,
    attempt,
    greatest_overlap,
    make_model,
)
from evac.physics.scenes import one_direction, room
from evac.physics.state import make_crowd

QUICK = extremes(quick=True)
FULL = extremes(quick=False)

NSM1 = {name for name in VARIANTS if name.startswith("NSM1")}
NSM2 = {name for name in VARIANTS if name.startswith("NSM2")}
GAP = 1.001e-4  # NSM1's tolerance [m]


def all_alike(kind, least, greatest):
    return dict.fromkeys(VARIANTS, (kind, least, greatest))


def models(names, kind, least, greatest):
    return dict.fromkeys(names, (kind, least, greatest))


#: What comes of a scene with each model: the verdict, and between what the error lies, by theory or by what is asked.
EXPECTED = {
    # NSM2 keeps an overlap as it is, DEM's springs and NSM1's position solve part it
    # DEM: pressed against the wall by its own drive, if it gets there in time from where the springs have thrown it
    "coincident centres": models(NSM1, HANDLED, 0.0, GAP)
    | models(NSM2, DEGRADED, 0.39, 0.4)
    | {"DEM": ({HANDLED, DEGRADED}, 0.0, 0.03)},
    "half-overlapping start": models(NSM1, HANDLED, 0.0, GAP)
    | models(NSM2, DEGRADED, 0.19, 0.2)
    | {"DEM": ({HANDLED, DEGRADED}, 0.0, 0.03)},
    # pi/(2 sqrt 3) of the floor at most can be covered: the overlap must stay, but nobody may leave the room
    # and percussions that grow with K_N where people are squeezed may throw somebody faster than a run allows:
    # which it is turns on rounding
    "denser than discs can pack": models(NSM1 | {"NSM2 K_N = 0"}, {DEGRADED, BEYOND}, 0.2, 0.26)
    | models(["NSM2 K_N = 1e5", "NSM2 K_N = inf"], {DEGRADED, REFUSED}, 0.2, 0.26)
    | {"DEM": (REFUSED, 0.0, 0.0)},
    "400 people at a closed door": models(NSM1, HANDLED, 0.0, GAP)
    | models(NSM2, {DEGRADED, BEYOND}, 2e-3, 0.05)
    | {"DEM": (DEGRADED, 0.03, 0.2)},
    "door narrower than a body": all_alike({RIGHT, HANDLED}, 0.0, 0.0),
    # a body off the middle of the gap gets the springs' energy, 1.2e5 N/m over 0.1 m, as speed along it
    "squeezed between two walls": models(NSM1 | NSM2, {RIGHT, HANDLED}, 0.0, 0.02) | {"DEM": (DEGRADED, 0.02, 3.9)},
    "UTM coordinates": all_alike({RIGHT, HANDLED}, 0.0, 1e-6),
    "UTM coordinates, touching": all_alike({RIGHT, HANDLED}, 0.0, 1e-3),
    # restitution returns every push of the drive
    "60 s against a wall": all_alike({RIGHT, HANDLED}, 0.0, 0.005)
    | models(["NSM2 K_N = 1e5", "NSM2 K_N = inf"], DEGRADED, 0.005, 1.5),
}

#: The same for the large and the long scene.
EXPECTED_LARGE = {
    "10000 people at a closed door": {
        "DEM": (REFUSED, 0.0, 0.0),
        "NSM1 inertial": (HANDLED, 0.0, GAP),
        "NSM2 K_N = 1e5": (BEYOND, 0.015, 0.15),
    },
    "3600 s against a wall": {
        "DEM": (RIGHT, 0.0, 0.005),
        "NSM1 inertial": (HANDLED, 0.0, 0.005),
        "NSM2 K_N = 1e5": (DEGRADED, 0.005, 1.5),
    },
}


def check(verdict, expected):
    kind, least, greatest = expected
    assert verdict.kind in (kind if isinstance(kind, set) else {kind}), verdict
    if verdict.kind != REFUSED:
        assert least - 1e-9 <= verdict.error <= greatest + 1e-9, verdict


def test_every_extreme_scene_has_an_expected_outcome():
    assert set(EXPECTED) == set(QUICK)
    assert set(EXPECTED_LARGE) == set(FULL) - set(QUICK)


@pytest.mark.parametrize("variant", VARIANTS)
@pytest.mark.parametrize("name", QUICK)
def test_extreme_scene(name, variant):
    check(try_extreme(QUICK[name], variant), EXPECTED[name][variant])


@pytest.mark.slow
@pytest.mark.parametrize(("name", "variant"), [(name, model) for name, of in EXPECTED_LARGE.items() for model in of])
def test_large_or_long_extreme_scene(name, variant):
    check(try_extreme(FULL[name], variant), EXPECTED_LARGE[name][variant])


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
