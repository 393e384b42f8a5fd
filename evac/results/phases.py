"""Phases of an evacuation: when the alarm of each sounded, when its people left, and when its storeys were clear."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
import shapely
from typing_extensions import TypedDict

from evac.analysis.lines import Occupancy
from evac.base.arrays import FloatArray, IntArray
from evac.base.change import Change
from evac.building.model.building import Building
from evac.folder.textfiles import Amount, Count
from evac.people.population import Group
from evac.physics.state import Crowd

if TYPE_CHECKING:
    from evac.case.schema import PhaseSettings


class PhaseUse(TypedDict):
    """What became of a phase; times in s, null if that did not happen."""

    name: str
    of: tuple[str, ...]
    people: Count
    alarm: Amount | None
    first_start: Amount | None
    last_start: Amount | None
    last_out: Amount | None
    clear: Mapping[str, Amount | None]


def phases_of(
    phases: "Sequence[PhaseSettings]",
    building: Building,
    crowd: Crowd,
    groups: Sequence[Group],
    start: tuple[IntArray, FloatArray],
    changes: Sequence[Change],
    used: Mapping[str, Occupancy],
) -> list[PhaseUse]:
    """Return what became of each phase; its people are those whose start (levels, positions [m]) was in its places.

    `used`: the use of levels and stairs, by name.
    """
    uses = []
    for phase in phases:
        rows = np.unique(np.concatenate([_starting(name, building, groups, *start) for name in phase.of]))
        alarms = [change.time for change in changes if change.kind == "alarm" and change.what in phase.of]
        starts = crowd.start_time[rows][np.isfinite(crowd.start_time[rows])]
        out = crowd.exit_time[rows]
        titles = dict.fromkeys(building.levels[level].title for level in np.unique(start[0][rows]).tolist())
        uses.append(
            PhaseUse(
                name=phase.name,
                of=phase.of,
                people=len(rows),
                alarm=min(alarms, default=None),
                first_start=float(starts.min()) if len(starts) else None,
                last_start=float(starts.max()) if len(starts) else None,
                last_out=float(out.max()) if len(out) and np.isfinite(out).all() else None,
                clear={title: used[title]["last_left"] for title in titles},
            )
        )
    return uses


def _starting(name: str, building: Building, groups: Sequence[Group], level: IntArray, at: FloatArray) -> IntArray:
    """Return the people who started in a place or belong to a group."""
    if not (parts := building.parts_named(name)):
        return next(group.rows for group in groups if group.name == name)
    own = [(level == part.level) & shapely.intersects_xy(part.polygon, *at.T) for part in parts]
    return np.flatnonzero(np.logical_or.reduce(own)).astype(np.int32)
