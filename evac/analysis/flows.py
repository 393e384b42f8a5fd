"""The flow of people through exits."""

import math
from collections.abc import Mapping

import numpy as np
from typing_extensions import TypedDict

from evac.base.arrays import FloatArray, IntArray
from evac.building.model.building import Building
from evac.folder.textfiles import Amount, Count

#: Share of the people who pass before, and of those who pass after, the interval in which a flow counts as steady.
MARGIN = 0.2

#: Least number of people for a steady flow.
FEWEST = 20


def steady_flow(times: FloatArray) -> float:
    """Return the flow between the first and the last fifth of those who pass at ascending `times` [s], in 1/s.

    NaN for a single person, and for people who all pass at the same time.
    """
    first, last = int(MARGIN * len(times)), int((1.0 - MARGIN) * len(times))
    if last == first or times[last] == times[first]:
        return float("nan")
    return float((last - first) / (times[last] - times[first]))


class ExitUse(TypedDict):
    """Use of an exit [s], [m], [1/s], [1/(m s)]; flows of fewer than `FEWEST` people, or all at one time, are None."""

    people: Count
    last_out: Amount | None
    width: Amount
    flow: Amount | None
    flow_per_metre: Amount | None


def exit_table(building: Building, exit_used: IntArray, exit_time: FloatArray) -> Mapping[str, ExitUse]:
    """Return the use of each exit, by name; exits (n,) are -1 and times (n,) [s] NaN of people inside."""
    table = {}
    for exit_ in building.exits:
        times = np.sort(exit_time[exit_used == exit_.index])
        flow = steady_flow(times) if times.size >= FEWEST else math.nan
        table[exit_.name] = ExitUse(
            people=times.size,
            last_out=float(times[-1]) if times.size else None,
            width=exit_.width,
            flow=None if math.isnan(flow) else flow,
            flow_per_metre=None if math.isnan(flow) else flow / exit_.width,
        )
    return table
