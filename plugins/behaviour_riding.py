"""Riding: people stand on one side of escalators and moving walkways, and walk on the other."""

import numpy as np
import shapely

from evac.base.parameters import Parameter
from evac.people.behaviour import Behaviour, BehaviourScene
from evac.physics.state import Crowd

ABREAST = 0.8  #: Least width with room for two people beside each other, a step of 0.8 m between balustrades [m].

#: Distance from the middle of their side within which people have taken it, and over which they turn to it [m].
BESIDE, TURNING = 0.05, 0.5

SIDESTEP = 0.3  #: Share of their speed at which people step aside who are going to stand.


class Riding(Behaviour):
    """People stand on ground that moves, except for a share of them, who walk.

    Whoever steps on an escalator or a moving walkway that moves stands there from the next tick on, or walks at the
    own speed relative to it. Where two have room beside each other, from a width of 0.8 m, people who stand take the
    middle of the half on `side`, and those who walk the other one. On one that has stopped, all walk.
    """

    name = "riding"
    saved = ("_walks",)
    reads = ("level", "position")
    writes = ("speed_factor", "extra_direction")
    group_keys = ("walking",)

    walking = Parameter(0.25, "share of the people who walk on moving ground", minimum=0.0, maximum=1.0)
    side = Parameter("right", "side on which people stand", choices=("right", "left"))

    def prepare(self, scene: BehaviourScene) -> None:
        """Draw who walks."""
        self._scene = scene
        share = np.full(len(scene.crowd.level), self.walking)
        for group in scene.groups:
            share[group.rows] = group.settings.get("walking", self.walking)
        self._walks = scene.generator.random(len(share)) < share

    def act(self, crowd: Crowd, time: float) -> None:
        """Stop those who stand, and lead all on moving ground to their sides."""
        for level, x, y in sorted(self._scene.building.moving):
            rows = np.flatnonzero(crowd.level == level)
            if not len(rows):
                continue
            along = np.array([x, y]) / np.hypot(x, y)
            left = np.array([-along[1], along[0]])
            across = shapely.get_coordinates(self._scene.building.levels[level].polygon) @ left
            width, middle = np.ptp(across), 0.5 * (across.min() + across.max())
            stands = ~self._walks[rows]
            if width < ABREAST:
                crowd.speed_factor[rows[stands]] = 0.0
                continue
            is_left = stands == (self.side == "left")
            off = middle + np.where(is_left, 0.25, -0.25) * width - crowd.position[rows] @ left
            crowd.speed_factor[rows] *= np.where(stands, np.where(np.abs(off) > BESIDE, SIDESTEP, 0.0), 1.0)
            aside = np.clip(off / TURNING, -1.0, 1.0)
            aside[stands] = np.sign(off[stands])
            crowd.extra_direction[rows] += aside[:, None] * left - stands[:, None] * along
