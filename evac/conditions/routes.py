"""Routes in smoke: the share of the speed that it leaves at the nodes of all levels, and when it has changed."""

import math
import time
from typing import TYPE_CHECKING

import numpy as np
from scipy.ndimage import minimum_filter
from scipy.spatial import KDTree

from evac.base.arrays import BoolArray, FloatArray, IndexArray
from evac.base.saved import Bounds, Saved
from evac.building.model.building import Building
from evac.conditions.air import Air
from evac.conditions.dose import irritant_concentration
from evac.conditions.law import SmokeLaw, share_in_smoke
from evac.conditions.source import IRRITANTS
from evac.directions.fields import Fields
from evac.directions.raster.grids import OWN
from evac.directions.smoky import Smoky
from evac.people.groups import reference_speeds
from evac.physics.state import Crowd

if TYPE_CHECKING:
    from evac.case.case import Case
    from evac.simulation.scene import Scene

#: Factor of the time where people turn back, and over people who lie there, if there is another way.
TURN_BACK = 100.0


class RoutesInSmoke(Saved):
    """Has routes solved again when smoke has changed by more than `smoke.noticed` on a level.

    Others walk round people whom gases or heat have stopped, (n,) bool, an array that its owner changes.
    """

    saved = ("_counts", "_version")

    def __init__(self, case: "Case", air: Air, law: SmokeLaw, crowd: Crowd, stopped: BoolArray) -> None:
        self._settings, self._air, self._law, self._crowd, self._stopped = case.smoke, air, law, crowd, stopped
        self._height = float(crowd.height.mean())
        flat, up, down = reference_speeds(case)
        self._flat, self._sloped = flat, 0.5 * (up + down)
        names = ("extinction", "temperature", "radiation", *(IRRITANTS if case.smoke.irritants else ()))
        self._quantities = tuple(name for name in air.quantities if name in names)
        self._ticks = max(1, round(case.smoke.period / case.simulation.tick))
        self._nodes: list[tuple[IndexArray, FloatArray, FloatArray, FloatArray]] = []  # of each level
        self._of: object = None  # the grids that the nodes are those of
        self._version = -1
        self._counts, self._seconds = np.zeros(2, np.int64), 0.0  # solves, and levels that were solved in them

    def is_due(self, tick: int, version: int) -> bool:
        """Return whether to look at the smoke at a tick: in each period, and when the scene has changed."""
        return tick % self._ticks == 0 or version != self._version

    def update(self, now: float, scene: "Scene") -> bool:
        """Solve the routes again where smoke has changed at a time of the run [s]; return whether any was solved."""
        self._version = scene.ways_version
        began = time.process_time()
        self._find_nodes(scene.building, scene.fields)
        smoky: Smoky | None = scene.smoky
        size = scene.fields.grids[0].grids.size
        before = np.ones(size) if smoky is None else smoky.share
        share = before.copy()
        for level, (nodes, *_) in enumerate(self._nodes):
            share[nodes] = self._share_on(level, now)
        if (share < 1.0).any():
            share = _widened(scene.fields, share)
        self._walk_round(share)
        differs = [np.abs(share[nodes] - before[nodes]).max(initial=0.0) for nodes, *_ in self._nodes]
        changed = set(np.flatnonzero(np.array(differs) > self._settings.noticed).tolist())
        if changed:
            solved = scene.in_smoke().solve(changed, share)
            self._counts += (1, solved)
        self._seconds += time.process_time() - began
        return bool(changed)

    def _find_nodes(self, building: Building, fields: Fields) -> None:
        """Find places and heights of heads at the nodes on the ground of all levels, and the speeds in clear air."""
        if self._of is fields.grids:
            return
        self._of, self._nodes = fields.grids, []
        for level, grid in zip(building.levels, fields.grids[0].grids.levels, strict=True):
            own = np.flatnonzero(grid.sheet == OWN)
            places = grid.window.places(np.stack(np.unravel_index(own, grid.window.shape), axis=1))
            heads = self._air.heads_at(np.full(len(own), level.index, np.int32), places, self._height)
            desired = np.full(len(own), self._flat if not level.climb.any() else self._sloped)
            self._nodes.append((grid.offset + own, places, heads, desired))

    def _share_on(self, level: int, now: float) -> FloatArray:
        """Return the share (n,) of the speed at the nodes of a level, less where people turn back."""
        nodes, places, heads, desired = self._nodes[level]
        at = np.full(len(nodes), level, np.int32)
        air = dict(zip(self._quantities, self._air.at(self._quantities, now, at, places, heads), strict=True))
        smoke = air.get("extinction", np.zeros(len(nodes)))
        irritants = irritant_concentration(air) if any(name in air for name in IRRITANTS) else None
        share, settings = share_in_smoke(self._law, desired, smoke, irritants), self._settings
        turns_back = smoke * settings.visibility > settings.contrast
        for name, limit in (("temperature", settings.temperature), ("radiation", settings.radiation)):
            if name in air:
                turns_back |= air[name] > limit
        return np.where(turns_back, share / TURN_BACK, share)

    def _walk_round(self, share: FloatArray) -> None:
        """Reduce the shares (nodes,) of the speed where others would touch people who have been stopped."""
        crowd = self._crowd
        for level in np.unique(crowd.level[self._stopped & (crowd.level >= 0)]).tolist():
            nodes, places, *_ = self._nodes[level]
            rows = np.flatnonzero(self._stopped & (crowd.level == level))
            away, nearest = KDTree(crowd.position[rows]).query(places)
            touching = away < crowd.radius[rows[nearest]] + crowd.radius.mean()
            share[nodes[touching]] /= TURN_BACK

    def report(self) -> dict[str, float]:
        """Return what the summary of a run says about the solves."""
        return {"solves": int(self._counts[0]), "levels_solved": int(self._counts[1]), "cpu_seconds": self._seconds}

    def bounds(self) -> dict[str, Bounds]:
        """Return the bounds of the counts and the version."""
        return {"_counts": Bounds(0, np.iinfo(np.int64).max), "_version": Bounds(-1, np.iinfo(np.int64).max)}


def _widened(fields: Fields, share: FloatArray) -> FloatArray:
    """Return the least share (nodes,) of the speed within the clearance of each node, also across portals.

    Paths keep their clearance from posts by a slowness that is up to nine times as great beside them. Where much smoke
    ends at a door or a portal, they would lead along the post, since what lies behind it costs next to nothing.
    """
    grids = fields.grids[0].grids
    reach = 1 + 2 * (1 + math.ceil(fields.clearance / grids.lattice.spacing))
    widened = share.copy()
    for grid in grids.levels:
        sheet, source = grid.sheet.ravel(), grid.source.ravel()
        own, halo = np.flatnonzero(sheet == OWN), np.flatnonzero((sheet != OWN) & (source >= 0))
        there = np.ones(len(sheet))
        there[own], there[halo] = share[grid.offset + own], share[source[halo]]
        least = minimum_filter(there.reshape(grid.window.shape), reach, mode="constant", cval=1.0)
        widened[grid.offset + own] = least.ravel()[own]
    return widened
