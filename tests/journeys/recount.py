"""What a run says of itself, computed from its trajectory and its tables with nothing of evac."""

import csv
import json
import math
from collections import Counter
from functools import cached_property
from itertools import pairwise

import numpy as np
import pyarrow as pa
from shapely.geometry import Point, shape

#: Slowest speed that is no waiting [m/s], side of the cells of maps and radius of their kernel [m].
WAITING, SIDE, RADIUS = 0.2, 0.2, 0.7

#: Cells on each side that the kernel reaches.
REACH = 9


class Recount:
    """The files of a result folder, and what follows from them."""

    def __init__(self, folder):
        self.folder = folder
        table = pa.ipc.open_stream((folder / "trajectory.evac").read_bytes()).read_all()
        self.header = json.loads(table.schema.metadata[b"evac.trajectory"])
        self.frames = list(zip(table["time"].to_pylist(), table["people"].to_pylist(), strict=True))
        self.people, self.crossings = rows_of(folder / "people.csv"), rows_of(folder / "crossings.csv")
        self.summary = json.loads((folder / "summary.json").read_text())
        self.building, self.levels = self.header["building"], self.header["building"]["levels"]
        self.origin = np.array(self.header["origin"])
        self.end = self.summary["simulated_time"]
        self.groups = {name: [one for one in self.people if one["group"] == name] for name in self.header["groups"]}
        lines = [one for one in self.building.get("places", ()) if one["kind"] == "line"]
        self.lines = {one["name"]: math.dist(*one["shape"]["coordinates"]) for one in lines}
        stay = ("", "inf")  # who stays
        at_places = self.at_places = {row for place in self.summary["places"] for row in place["people"]}
        self.leaving = [
            one
            for row, one in enumerate(self.people)
            if one["exit_time"] or (one["arrival_time"] and one["response_time"] not in stay and row not in at_places)
        ]
        self.missing = sum(not one["arrival_time"] for one in self.people)
        self.stopped = sum(bool(one.get("stopped_at")) for one in self.people)
        self.staying = sum(one["response_time"] == "inf" and not one["exit_time"] for one in self.people)
        self.stairs = {
            name: {level["name"] for level in self.levels if level["stair"] == name} for name in self.summary["stairs"]
        }

    @cached_property
    def stays(self):
        """When each person is on which level: [from, to, person, level], from the tables alone."""
        levels = {one["name"]: [self.levels[k]["name"] for k in one["levels"]] for one in self.building["portals"]}
        found = []
        for number, person in enumerate(self.people):
            if not person["arrival_time"]:
                continue
            since, level = float(person["arrival_time"]), person["start_level"]
            for crossing in self.crossings:
                if int(crossing["person"]) == number:
                    found.append((since, float(crossing["time"]), number, level))
                    first, second = levels[crossing["portal"]]
                    since, level = float(crossing["time"]), second if level == first else first
            found.append((since, float(person["exit_time"] or np.inf), number, level))
        return found

    def there(self, time):
        """Persons and levels at a time."""
        return [(person, level) for since, until, person, level in self.stays if since <= time < until]

    def use_of(self, levels):
        """People who used some levels, greatest number at once, and when the last one left."""
        own = [(since, until, person) for since, until, person, level in self.stays if level in levels]
        moments = {since for since, _, _ in own}
        at_once = [len({person for since, until, person in own if since <= time < until}) for time in moments]
        last = max((until for _, until, _ in own), default=np.inf)
        return len({person for _, _, person in own}), max(at_once, default=0), last if last < np.inf else None

    def alike(self, columns):
        """Names of the groups that have the same distributions of some quantities."""
        found, columns = {}, list(columns)
        for group in self.summary["case"]["people"]:
            found.setdefault(repr([group[column] for column in columns]), []).append(group["name"])
        return found.values()

    def exit_times(self, name=None):
        """Ascending exit times, by one exit or all."""
        left = [float(one["exit_time"]) for one in self.people if one["exit_time"] and name in (None, one["exit"])]
        return sorted(left)

    def speed(self, one):
        """Speed along the slope of what is recorded of a person."""
        level, velocity = self.levels[one["level"]], np.array(one["motion"][2:4])
        return float(np.hypot(np.hypot(*velocity), np.tan(level["slope"]) * (velocity @ level["uphill"])))

    def heights(self, here):
        """Heights of people on their levels, which are planes."""
        found = []
        for one in here:
            level, place = self.levels[one["level"]], np.array(one["motion"][:2]) + self.origin
            corners = np.array([self.building["vertices"][k] for k in level["triangles"][0]])
            normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
            found.append(corners[0, 2] - (place - corners[0, :2]) @ normal[:2] / normal[2])
        return found

    def is_open(self, name, time):
        """Whether an exit is open at a time."""
        own = [one for one in self.summary["changes"] if one["what"] == name and one["time"] <= time]
        kinds = [one["kind"] for one in own if one["kind"] in ("open", "close")]
        return not kinds or kinds[-1] == "open"

    def is_in(self, name, one):
        """Whether a person is in an area."""
        (area,) = [area for area in self.building["areas"] if area["name"] == name]
        place = Point(np.array(one["motion"][:2]) + self.origin)
        return area["level"] == one["level"] and shape(area["polygon"]).buffer(1e-4).contains(place)

    @cached_property
    def waits(self):
        """How long each person inside has waited since the frame before, for each frame: [{person: s}]."""
        found = [dict.fromkeys((one["person"] for one in self.frames[0][1]), 0.0)]
        for (before, there), (time, here) in pairwise(self.frames):
            ready = {one["person"] for one in there if self.has_started(one, before)}
            found.append(
                {
                    one["person"]: time - before
                    if one["person"] in ready and self.has_started(one, time) and self.speed(one) < WAITING
                    else 0.0
                    for one in here
                }
            )
        return found

    def has_started(self, one, time):
        """Whether a person walks, and does not stand at a refuge, after gases or because of a behaviour."""
        return float(self.people[one["person"]]["response_time"]) <= time and one["started"]

    def waited(self, person, last):
        """Time waited by a person until a frame."""
        return sum(waits.get(person, 0.0) for waits in self.waits[: last + 1])

    def force(self, person, last):
        """Mean contact force of a person over the last second until a frame."""
        until, forces = self.frames[last][0], []
        for time, there in reversed(self.frames[: last + 1]):
            if time <= until - 1.0 + 1e-9:
                break
            forces += [one["motion"][4] for one in there if one["person"] == person]
        return float(np.mean(forces[::-1]))

    def jams(self):
        """When ten people wait at once on the floors of a storey or on a stair for the first time, and what is said."""
        storeys = {}
        for level in self.levels:
            if level["kind"] == "floor":
                storeys.setdefault(round(level["z_min"], 2), []).append(level["name"])
        name_of = {one: ", ".join(names) for names in storeys.values() for one in names}
        found = {}
        for (time, here), waits in zip(self.frames, self.waits, strict=True):
            of = (self.levels[one["level"]] for one in here if waits[one["person"]])
            places = Counter(level["stair"] or name_of[level["name"]] for level in of)
            for place, count in places.items():
                if count >= 10:
                    found.setdefault(place, (time, f"{place}: jam, {count} wait"))
        return set(found.values())

    def longest_queue(self):
        """Words of the queue with the longest waiting in total, from recorded positions."""
        waits = {}  # place and level: list of (person, time, duration, position, level)
        for (time, here), spans in zip(self.frames, self.waits, strict=True):
            for one in here:
                if not spans[one["person"]]:
                    continue
                at, level = np.array(one["motion"][:2]) + self.origin, one["level"]
                stair = self.levels[level]["stair"]
                place = (f"on stair {stair!r}", -1) if stair else (self._nearest(at, level), level)
                waits.setdefault(place, []).append((one["person"], time, spans[one["person"]], at, level))
        if not waits:
            return "Nobody had to wait"
        (place, _), rows = max(waits.items(), key=lambda item: sum(row[2] for row in item[1]))
        people, at_once = len({row[0] for row in rows}), Counter(row[1] for row in rows)
        most = max(at_once.values())
        peak = min(time for time, count in at_once.items() if count == most)
        then = [row for row in rows if row[1] == peak]
        x, y = np.mean([row[3] for row in then], axis=0)
        level = Counter(row[4] for row in then).most_common(1)[0][0]
        mean = sum(row[2] for row in rows) / people
        who = "person" if people == 1 else "people"
        return (
            f"Longest queue, {place}: {people} {who} waited {mean:.1f} s on average, at most {most} at once, "
            f"at {peak:.1f} s around ({x:.1f}, {y:.1f}) on {self.levels[level]['name']!r}"
        )

    def _nearest(self, at, level):
        ways = [
            (f"before exit {way['name']!r}", way["segments"]) for way in self.building["exits"] if way["level"] == level
        ]
        ways += [
            (f"before door {way['name']!r}", [way["segment"]])
            for way in self.building["doors"]
            if way["level"] == level
        ]
        for way in self.building["portals"]:
            if level in way["levels"]:
                other = self.levels[sum(way["levels"]) - level]
                what = f"before stair {other['stair']!r}" if other["stair"] else f"before level {other['name']!r}"
                ways.append((what, way["segments"]))
        return min(ways, key=lambda way: min(distance_to(part, at) for part in way[1]))[0]

    def crossed(self, level, segment):
        """Times of passages over a segment of a level, to the left and to the right of it."""
        first, along = np.array(segment[:2]), np.array(segment[2:]) - segment[:2]
        found = {True: [], False: []}
        for (before, there), (time, here) in pairwise(self.frames):
            now = {one["person"]: one for one in here}
            for one in there:
                start = np.array(one["motion"][:2]) + self.origin
                other = now.get(one["person"])
                if other is None:
                    parts = [
                        part
                        for way in self.building["exits"]
                        if way["level"] == one["level"]
                        for part in way["segments"]
                    ]
                    end = min((foot_of(part, start) for part in parts), key=lambda foot: np.hypot(*(foot - start)))
                else:
                    end = np.array(other["motion"][:2]) + self.origin
                if level not in (one["level"], (other or one)["level"]):
                    continue
                a, b = (along[0] * (p - first)[1] - along[1] * (p - first)[0] for p in (start, end))
                if (a < 0.0) != (b < 0.0):
                    share = a / (a - b)
                    if 0.0 <= (start + share * (end - start) - first) @ along / (along @ along) <= 1.0:
                        found[bool(b >= 0.0)].append(before + share * (time - before))
        return {way: sorted(times) for way, times in found.items()}

    @cached_property
    def passages(self):
        """Times of passages by (kind, name, direction), and the width of each, in the order of flows.csv."""
        found, level_of = {}, {}
        for crossing in self.crossings:
            level_of.setdefault(crossing["portal"], []).append(crossing)
        until = {(person, end): level for _, end, person, level in self.stays}
        for way in self.building["portals"]:
            ends = [self.levels[index] for index in way["levels"]]
            names = [end["stair"] or end["name"] for end in ends]
            if names[0] == names[1]:
                continue  # within a stair
            times = {name: [] for name in names[::-1]}
            for one in level_of.get(way["name"], []):
                source = until[int(one["person"]), float(one["time"])]
                times[names[source == ends[0]["name"]]].append(float(one["time"]))
            for name, passed in times.items():
                if passed:
                    found["portal", way["name"], f"to {name}"] = sorted(passed), way["width"]
        for way in self.building["exits"]:
            found["exit", way["name"], "out"] = self.exit_times(way["name"]), way["width"]
        ways = [("door", way["name"], way["level"], way["segment"], way["width"]) for way in self.building["doors"]]
        for name, width in self.lines.items():
            place = next(one for one in self.building["places"] if (one["kind"], one["name"]) == ("line", name))
            ways.append(("line", name, place["level"], np.ravel(place["shape"]["coordinates"]).tolist(), width))
        for kind, name, level, segment, width in ways:
            for is_left, times in self.crossed(level, segment).items():
                if times:
                    found[kind, name, "to the left" if is_left else "to the right"] = times, width
        return found

    def cells(self):
        """All that maps need of the people at recorded times: a row (frame, level, x, y, ...) for each."""
        rows = []
        for k, (time, here) in enumerate(self.frames):
            for one in here:
                x, y = np.array(one["motion"][:2]) + self.origin
                row = k, one["person"], one["level"], x, y, *one["motion"][2:4], self.speed(one)
                rows.append((*row, self.has_started(one, time), self.waits[k][one["person"]]))
        return np.array(rows)


def rows_of(path):
    """Rows of a table; none if there is no such file."""
    return list(csv.DictReader(path.read_text(encoding="utf-8").splitlines())) if path.exists() else []


def foot_of(segment, point):
    """Point of a segment that is nearest to another point."""
    first, along = np.array(segment[:2]), np.array(segment[2:]) - segment[:2]
    return first + np.clip((point - first) @ along / (along @ along), 0.0, 1.0) * along


def distance_to(segment, point):
    """Distance of a point from a segment."""
    return float(np.linalg.norm(point - foot_of(segment, point)))


def steady(times):
    """Flow between the first and the last fifth of 20 people or more."""
    if len(times) < 20:
        return None
    first, last = int(0.2 * len(times)), int(0.8 * len(times))
    return (last - first) / (times[last] - times[first])


def time_of(times, people, percent):
    """When so many per cent of some people were out; None if they never were."""
    rank = max(math.ceil(percent / 100 * people), 1)
    return times[rank - 1] if rank <= len(times) else None


def fixed(value, digits, otherwise="-"):
    """A number with so many digits."""
    return otherwise if value is None else f"{value:.{digits}f}"


class Map:
    """Values of the maps of one level in single cells, each summed over the people."""

    def __init__(self, run, level, floor, origin):
        self.run, self.floor = run, np.argwhere(floor)
        self.origin, self.shape = np.array(origin), floor.shape
        self.time = np.array([time for time, _ in run.frames])
        bodies = run.cells()
        self.bodies = bodies[bodies[:, 2] == level]
        edges = np.concatenate([self.time[:1], 0.5 * (self.time[1:] + self.time[:-1]), self.time[-1:]])
        self.shares = np.diff(edges) / (self.time[-1] - self.time[0])
        self.own = np.floor((self.bodies[:, [4, 3]] - self.origin[::-1]) / SIDE).astype(int)
        self.kernel = np.exp(-((SIDE * np.arange(-REACH, REACH + 1)) ** 2) / RADIUS**2)
        self.kernel /= self.kernel.sum()

    def spread(self, cells, cell):
        """Share of the kernel around a cell that falls into others, and the reverse."""
        steps = np.abs(cells - cell)
        near = self.kernel[np.minimum(REACH + steps, 2 * REACH)].prod(axis=1)
        return np.where(steps.max(axis=1, initial=0) <= REACH, near, 0.0)

    def smooth(self, cell):
        """Values of the quantities that are sums of kernels."""
        weight = self.spread(self.own, cell)
        near = np.flatnonzero(weight)
        kept = np.array([max(0.05, self.spread(self.floor, own).sum()) for own in self.own[near]])
        density = weight[near] / kept / SIDE**2
        frame, _, _, _, _, vx, vy, speed, started, wait = self.bodies[near].T
        frame, share = frame.astype(int), self.shares[frame.astype(int)]
        at_once = np.bincount(frame, density, len(self.time))
        walking = (share * density * started).sum()
        return {
            "density": (share * density).sum(),
            "max_density": at_once.max(),
            "speed": (share * density * started * speed).sum() / walking if walking > 1e-3 else np.nan,
            "flow": np.hypot((share * density * vx).sum(), (share * density * vy).sum()),
            "waiting": (density * wait).sum(),
        }

    def covered(self, cell):
        """Values of the quantities of bodies that cover a cell; between frames they move straight, in equal parts."""
        centre = self.origin + SIDE * (np.array(cell)[::-1] + 0.5)
        radius = np.array(self.run.header["radius"])
        frames = [self.bodies[self.bodies[:, 0] == k] for k in range(len(self.time))]
        last, people, pressure = np.nan, set(), 0.0

        def over(person, place):
            inside = np.hypot(*(place - centre).T) <= radius[person]
            return person[inside | (np.floor((place - self.origin) / SIDE) == np.array(cell)[::-1]).all(axis=1)]

        for k, here in enumerate(frames):
            person, place = here[:, 1].astype(int), here[:, 3:5]
            found = over(person, place)
            people |= {*found.tolist()}
            if found.size:
                last = self.time[k] if k < len(frames) - 1 else np.inf
                forces = [self.run.force(one, k) / (2 * np.pi * radius[one]) for one in found.tolist()]
                pressure = max(pressure, *forces)
            if k == len(frames) - 1:
                break
            after = {int(row[1]): row[3:5] for row in frames[k + 1]}
            stays = np.array([one in after for one in person.tolist()], bool)
            if not stays.any():
                continue
            start, end = place[stays], np.array([after[one] for one in person[stays].tolist()])
            parts = math.ceil(np.hypot(*(end - start).T).max() / SIDE)
            for part in range(1, parts):
                found = over(person[stays], start + part / parts * (end - start))
                people |= {*found.tolist()}
                if found.size:
                    last = self.time[k] + part / parts * (self.time[k + 1] - self.time[k])
        return {"time_to_clear": last, "usage": float(len(people)), "contact_pressure": pressure}
