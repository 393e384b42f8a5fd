"""The extent of a body is asked in one place: with another shape there, all that touches has it."""

import json
import math
import os
import subprocess
import sys
from pathlib import Path

import numpy as np

from evac.jit import body_force
from evac.physics.extent import extent
from evac.physics.force import Force
from evac.physics.state import make_crowd
from evac_plugins.contact_dem import Dem
from evac_plugins.force_social import SocialForce
from tests.physics.scenes import make_building, make_engine

ROOT = Path(__file__).parents[2]

#: Half the depth of an ellipse that looks along x, as a share of half its width, which is the radius.
DEPTH = 0.6


@body_force
def keep_off(x, y, vx, vy, ex, ey, gap, nx, ny, parameters):
    push = parameters[0] * math.exp(-gap / parameters[1])
    return push * nx, push * ny


class KeepOff(Force):
    """Is felt in front of walls."""

    name = "keep_off"
    body = keep_off

    def packed(self):
        return np.array([50.0, 0.05])

    def cutoff(self):
        return 0.3


def ellipse(bodies, i, nx, ny):
    width = bodies.contact_radius[i]
    depth = DEPTH * width
    return width * depth / math.hypot(depth * ny, width * nx)


def walked(axis, radius):
    """Return places and forces of three people, one behind the other, who have walked along an axis into a wall."""
    along = np.array([[1.0, 0.0], [0.0, 1.0]][axis])
    corners = np.array([[0.15, -2.0], [0.15, 2.0]]) if axis == 0 else np.array([[2.0, 0.15], [-2.0, 0.15]])
    crowd = make_crowd(np.outer([0.05, -0.3, -0.6], along), np.outer([1.2] * 3, along), radius=radius)
    engine = make_engine(crowd, make_building(walls=[corners.ravel()]), forces=[SocialForce(), KeepOff()])
    engine.advance(Dem(), crowd, 0, 20, 0.01, False, True)
    pushes = engine.data.bodies.push[:3] @ along
    return [*(crowd.position @ along), *crowd.contact_force, *pushes, engine.report()["contacts"]]


def outcome():
    """Return walks of discs, and of ellipses with the same extents along the way."""
    discs = [walked(0, DEPTH * 0.2), walked(1, 0.2)]
    extent.function = ellipse
    return [discs, [walked(0, 0.2), walked(1, 0.2)]]


def test_ellipses_need_no_other_function():
    """In an interpreter that compiles nothing, they touch as discs do that have their extent along the way."""
    done = subprocess.run(
        [sys.executable, "-c", "import json; from tests.physics.test_extent import *; print(json.dumps(outcome()))"],
        env=os.environ | {"NUMBA_DISABLE_JIT": "1", "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=True,
        timeout=300,
    )
    discs, ellipses = json.loads(done.stdout)
    np.testing.assert_allclose(ellipses, discs, rtol=1e-9)
    assert all(walk[-1] > 5 for walk in discs)
    assert np.abs(np.subtract(*discs)[:3]).min() > 0.01
