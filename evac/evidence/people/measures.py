"""Measures of how people moved, taken as in the experiments: passing times, densities, speeds, headings.

Each measure of a scene returns a mapping of names with units to numbers; NaN where the scene had no such moment.
"""

from collections.abc import Mapping
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from evac.analysis.lines import steady_flow
from evac.base.arrays import FloatArray, IntArray

Values = Mapping[str, float]

#: Densities that separate the rows of the corridor [1/m2].
DENSITIES = (0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 3.5)

#: Numbers of people whose exit times at the narrow door are compared.
COUNTED = (10, 40, 75)

#: Moment after the first passage of the narrow door at which neighbours and headings are taken, and how far away [m].
MOMENT, NEAR = 20.0, 2.0

#: Time between two places that make a heading [s], and the least distance between them [m].
HEADING_TIME, LEAST_WAY = 0.2, 0.02


def speed_column(least: float, most: float) -> str:
    """Return the name of the mean speed of the moments with densities in a range."""
    return f"speed at {least:g} to {most:g} per m2 [m/s]"


def frames_column(least: float, most: float) -> str:
    """Return the name of the number of such moments."""
    return f"moments at {least:g} to {most:g} per m2"


#: All measures, the columns of the table of runs.
MEASURES = (
    "flow [1/s]",
    "flow per metre [1/s/m]",
    *(f"{count} out [s]" for count in COUNTED),
    "nearest neighbour [m]",
    "heading rms [deg]",
    "density [1/m2]",
    "speed [m/s]",
    *(column(*ends) for column in (speed_column, frames_column) for ends in pairwise(DENSITIES)),
    "last out [s]",
    "from inner corner [m]",
    "beside the straight corridor [-]",
    "beside one stream alone [-]",
    "share from the left [-]",
    "distance [m]",
)


class Line(NamedTuple):
    """A line across an axis that people pass in the direction of its sign."""

    axis: int
    at: float
    sign: int

    def beyond(self, position: FloatArray) -> FloatArray:
        """Return how far places (..., 2) are beyond the line [m]."""
        return self.sign * (position[..., self.axis] - self.at)


class Track(NamedTuple):
    """Places of all people at equal intervals."""

    time: FloatArray  # (t,) [s]
    position: FloatArray  # (t, n, 2) [m]
    level: IntArray  # (t, n): -1 for people who have left
    exit_time: FloatArray  # (n,): NaN for people who are left [s]

    @property
    def tick(self) -> float:
        """The interval [s]."""
        return float(self.time[1] - self.time[0])

    @property
    def inside(self) -> NDArray[np.bool_]:
        """Whether a person has not left yet, (t, n)."""
        return self.level >= 0


def passing_times(track: Track, line: Line) -> FloatArray:
    """Return when each person first passed a line [s], (n,); NaN for whoever did not."""
    beyond = line.beyond(track.position)
    passes = (beyond[:-1] < 0.0) & (beyond[1:] >= 0.0)
    first, who = passes.argmax(axis=0), np.arange(passes.shape[1])
    before, after = beyond[first, who], beyond[first + 1, who]
    has_passed = passes.any(axis=0)
    share = before / np.where(has_passed, before - after, 1.0)
    return np.where(has_passed, track.time[first] + share * track.tick, np.nan)


def door_flow(track: Track, line: Line, width: float) -> Values:
    """Return the steady flow per metre through a door."""
    return {"flow per metre [1/s/m]": steady_flow(np.sort(passing_times(track, line))) / width}


def narrow_door(track: Track, line: Line) -> Values:
    """Return flow, exit times from the first passage on, nearest neighbours and headings in front of the narrow door.

    The flow is that from the first to the last person.
    """
    times = np.sort(passing_times(track, line))
    past = times - times[0]
    return {
        "flow [1/s]": (len(times) - 1) / past[-1],
        **{f"{count} out [s]": past[count - 1] for count in COUNTED if count <= len(times)},
        "nearest neighbour [m]": nearest_neighbour(track, times[0] + MOMENT, line),
        "heading rms [deg]": heading_rms(track, times[0] + MOMENT, line),
    }


def _in_front(track: Track, frame: int, line: Line) -> NDArray[np.bool_]:
    """Return who is inside, before the line, and near the middle of it, which is on the other axis at 0."""
    place = track.position[frame]
    beyond = line.beyond(place)
    away: FloatArray = np.hypot(beyond, place[:, 1 - line.axis])
    near: NDArray[np.bool_] = track.inside[frame] & (beyond < 0.0) & (away < NEAR)
    return near


def nearest_neighbour(track: Track, time: float, line: Line) -> float:
    """Return the median distance of people in front of a door from their nearest neighbour [m]."""
    frame = min(round((time - track.time[0]) / track.tick), len(track.time) - 1)
    place, near = track.position[frame], _in_front(track, frame, line)
    away = place[near][:, None] - place[track.inside[frame]][None]
    distance = np.sort(np.hypot(away[..., 0], away[..., 1]), axis=1)
    return float(np.median(distance[:, 1])) if near.any() and distance.shape[1] > 1 else float("nan")


def heading_rms(track: Track, time: float, line: Line) -> float:
    """Return the root of the mean square by which headings turn in `HEADING_TIME` [deg], from 1 s before to 2 s after.

    Only people in front of the door count, while they move.
    """
    step = max(1, round(HEADING_TIME / track.tick))
    first, last = (round((time + shift - track.time[0]) / track.tick) for shift in (-1.0, 2.0))
    turns = []
    for frame in range(max(first, 0), min(last, len(track.time) - 2 * step), step):
        before, after = (track.position[k + step] - track.position[k] for k in (frame, frame + step))
        counts = _in_front(track, frame, line) & track.inside[frame + 2 * step]
        counts &= (np.hypot(*before.T) > LEAST_WAY) & (np.hypot(*after.T) > LEAST_WAY)
        cross = before[counts, 0] * after[counts, 1] - before[counts, 1] * after[counts, 0]
        turns.append(np.arctan2(cross, (before[counts] * after[counts]).sum(axis=1)))
    squares = np.square(np.degrees(np.concatenate(turns))) if turns else np.zeros(0)
    return float(np.sqrt(squares.mean())) if squares.size else float("nan")


def corridor(track: Track, area: tuple[float, float], width: float, out: Line, shares: tuple[float, float]) -> Values:
    """Return density, speed and flow in a corridor along -y, and the speeds at several densities.

    `area`: (y1, y2) of the measuring area, over the whole `width` [m]; the flow is counted at `out`; `shares` of the
    people have passed the middle of the area when the steady part begins, and ends.
    """
    low, high = area
    passed = np.sort(passing_times(track, Line(1, 0.5 * (low + high), -1)))
    begin, end = (passed[int(share * len(passed))] for share in shares)
    frames = np.flatnonzero((track.time >= begin) & (track.time <= end))
    frames = frames[(frames > 0) & (frames < len(track.time) - 1)]
    y = track.position[:, :, 1]
    is_in = (y[frames] > low) & (y[frames] < high) & track.inside[frames + 1]
    count = is_in.sum(axis=1)
    density = count / (width * (high - low))
    speeds = (y[frames - 1] - y[frames + 1]) / (2.0 * track.tick)
    speed = (speeds * is_in).sum(axis=1) / np.maximum(count, 1)
    values = {
        "density [1/m2]": float(density.mean()),
        "speed [m/s]": float(speed[count > 0].mean()) if count.any() else float("nan"),
        "flow [1/s]": steady_flow(np.sort(passing_times(track, out))),
    }
    for least, most in pairwise(DENSITIES):
        of = (density >= least) & (density < most)
        values[speed_column(least, most)] = float(speed[of].mean()) if of.any() else float("nan")
        values[frames_column(least, most)] = int(of.sum())
    return values


def stair(track: Track, line: Line, flight: tuple[float, float], width: float, cosine: float) -> Values:
    """Return flow per metre and speed along the slope on a flight along x, from the first to the last fifth."""
    times = np.sort(passing_times(track, line))
    begin, end = np.quantile(times, (0.2, 0.8))
    frames = np.flatnonzero((track.time >= begin) & (track.time <= end))
    x = track.position[:, :, 0]
    is_on = (x[frames] > flight[0]) & (x[frames] < flight[1])
    speed = np.abs(x[frames] - x[frames - 1])[is_on] / (track.tick * cosine)
    return {"flow per metre [1/s/m]": steady_flow(times) / width, "speed [m/s]": float(speed.mean())}


def two_way(track: Track, sign: IntArray, half: float, width: float, times: tuple[float, float]) -> Values:
    """Return speed, density and flow of two crowds that walk along x, where they are mixed.

    `sign` (n,): direction of each person, 1 or -1. The measuring area is from -half to half [m]. Between the `times`
    [s], moments count in which each crowd is 0.35 to 0.65 of the people in the area.
    """
    x = track.position[:, :, 0]
    is_in = (np.abs(x) < half) & track.inside
    count = is_in.sum(axis=1)
    share = (is_in & (sign > 0)).sum(axis=1) / np.maximum(count, 1)
    is_between = (track.time > times[0]) & (track.time < times[1])
    frames = np.flatnonzero(is_between & (share > 0.35) & (share < 0.65))
    if not len(frames):
        return dict.fromkeys(("speed [m/s]", "density [1/m2]", "flow per metre [1/s/m]"), float("nan"))
    speed = float((sign * (x[frames] - x[frames - 1]))[is_in[frames]].mean()) / track.tick
    density = float(count[frames].mean()) / (2.0 * half * width)
    return {"speed [m/s]": speed, "density [1/m2]": density, "flow per metre [1/s/m]": speed * density}


def last_out(track: Track, people: int) -> Values:
    """Return when the last one of the first `people` left."""
    return {"last out [s]": float(track.exit_time[:people].max())}


def bend(track: Track) -> Values:
    """Return when the last one left, and the median distance from the inner corner of a bend, which is at (0, 0).

    The distance is that at which people pass the diagonal of the bend, from x < -y to x > -y.
    """
    along = track.position.sum(axis=2)
    passes = (along[:-1] < 0.0) & (along[1:] >= 0.0)
    frame, who = passes.argmax(axis=0), np.flatnonzero(passes.any(axis=0))
    away = np.hypot(*track.position[frame[who], who].T)
    return {**last_out(track, len(track.exit_time)), "from inner corner [m]": float(np.median(away))}


def flow_beside(track: Track, lines: tuple[Line, Line]) -> Values:
    """Return the steady flow of the first half of the people through a line over that of the others through theirs."""
    half = len(track.exit_time) // 2
    halves = slice(half), slice(half, None)
    times = [np.sort(passing_times(track, line)[own]) for line, own in zip(lines, halves, strict=True)]
    first, second = map(steady_flow, times)
    return {"beside the straight corridor [-]": first / second}


def last_beside(track: Track, alone: int) -> Values:
    """Return when the last one left over when the last of the last `alone` people did, who are by themselves."""
    last = [float(track.exit_time[own].max()) for own in (slice(-alone), slice(-alone, None))]
    return {"beside one stream alone [-]": last[0] / last[1]}


def share_of_first(track: Track, line: Line, first: int) -> Values:
    """Return the share of the `first` people among those who pass a line, while the second to the fourth fifth pass."""
    order = passing_times(track, line).argsort()
    fifth = len(order) // 5
    return {"share from the left [-]": float((order[fifth : 4 * fifth] < first).mean())}


def distance_in_file(track: Track, behind: int) -> Values:
    """Return the mean distance along x in the last 15 s, from the foremost to the one who is `behind` places later."""
    x = track.position[track.time > track.time[-1] - 15.0, :, 0]
    file = np.sort(x, axis=1)[:, ::-1]
    return {"distance [m]": float((file[:, 0] - file[:, behind]).mean()) / behind}
