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

#: How long people are watched after a passage, the spans for which that is asked [s], and the share of waiting with
#: which a queue goes on.
BEYOND, SPAN, GOES_ON = 4.0, 5.0, 0.25


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

    def named(self, name, piece, parts="pieces"):
        """The name of a level that a table gives, or of a portal, with the number of the piece of a stair."""
        return list(self.summary["stairs"][name][parts])[int(piece)] if piece else name

    @cached_property
    def stays(self):
        """When each person is on which level: [from, to, person, level], from the tables alone."""
        levels = {one["name"]: [self.levels[k]["name"] for k in one["levels"]] for one in self.building["portals"]}
        found = []
        for number, person in enumerate(self.people):
            if not person["arrival_time"]:
                continue
            since = float(person["arrival_time"])
            level = self.named(person["start_level"], person["start_piece"])
            for crossing in self.crossings:
                if int(crossing["person"]) == number:
                    found.append((since, float(crossing["time"]), number, level))
                    first, second = levels[self.named(crossing["portal"], crossing["piece"], "portals")]
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

    def queue(self):
        """Words of what holds up most, and its time, head, level before it and most people, from recorded motion."""
        waits, watched, passed = {}, Counter(), self.passed()
        for k, (time, here) in enumerate(self.frames):
            for one in here:
                past = [way for since, way in passed[one["person"]] if 0.0 <= time - since <= BEYOND][-1:]
                for way in past:
                    watched[way, time // SPAN] += (time - self.frames[k - 1][0]) if k else 0.0
                    watched[way, time // SPAN, "waits"] += self.waits[k][one["person"]]
        for k, (time, here) in enumerate(self.frames):
            for one in (one for one in here if self.waits[k][one["person"]]):
                at, level = np.array(one["motion"][:2]) + self.origin, one["level"]
                ahead = [(since, way) for since, way in passed[one["person"]] if since > time]
                while len(ahead) > 1 and self.goes_on(watched, ahead[0][1], time // SPAN):
                    ahead.pop(0)
                since, (cause, way, _) = ahead[0] if ahead else (np.inf, (*self._nearest(at, level), 0))
                row = one["person"], time, self.waits[k][one["person"]], at, level, way, since
                waits.setdefault(cause, []).append(row)
        total = sum(row[2] for rows in waits.values() for row in rows)
        if not total:
            return "Nobody had to wait", None
        sums = {cause: sum(row[2] for row in rows) for cause, rows in waits.items()}
        shares = {cause: waited / total for cause, waited in sums.items()}
        causes = [
            cause
            for cause in sorted(waits, key=lambda one: -sums[one])
            if sums[cause] >= max(30.0, 5.0 * len({row[0] for row in waits[cause]}))
        ]
        rows = waits[causes[0]] if causes else []
        if not causes:
            return f"Little waiting, {total:.1f} s of all people together", None
        people, at_once = len({row[0] for row in rows}), Counter(row[1] for row in rows)
        most = max(at_once.values())
        peak = min(time for time, count in at_once.items() if count == most)
        many = [time for time, count in at_once.items() if count >= max(1.0, 0.1 * most)]
        then = [row for row in rows if row[1] == peak]
        tail = self.levels[max(then, key=lambda row: (row[6], self.away(row)))[4]]
        heads = Counter(row[5] for row in then)
        way = min(heads, key=lambda one: (-heads[one], self.ways().index(one)))
        segment = way[2][len(way[2]) // 2]
        level = min((row for row in then if row[5] == way), key=self.away)[4]
        on = {level["stair"] or level["name"]: 0.0 for level in self.levels}
        for row in rows:
            on[self.levels[row[4]]["stair"] or self.levels[row[4]]["name"]] += row[2]
        who = "person" if people == 1 else "people"
        words = (
            f"What holds up most is {causes[0]}: {100 * shares[causes[0]]:.0f} % of all waiting; {people} {who} waited "
            f"{sum(row[2] for row in rows) / people:.1f} s on average, most on {max(on, key=on.get)!r}, from "
            f"{min(many):.1f} to {max(many):.1f} s, at most {most} at once, at {peak:.1f} s, back to "
            f"{tail['stair'] or tail['name']!r}"
        )
        if len(causes) > 1 and shares[causes[1]] >= 0.1:
            words += f"; next is {causes[1]}: {100 * shares[causes[1]]:.0f} % of all waiting"
        middle = 0.5 * (np.array(segment[:2]) + segment[2:])
        return words, (causes[0], peak, middle, self.levels[level]["stair"] or self.levels[level]["name"], most)

    def goes_on(self, watched, way, span):
        """Whether those who have just passed a way wait, in a span or in the last one in which somebody had."""
        spans = [key[1] for key in watched if len(key) == 2 and key[0] == way and key[1] <= span and watched[key]]
        return bool(spans) and watched[way, max(spans), "waits"] > GOES_ON * watched[way, max(spans)]

    def ways(self):
        """Portals but those within stairs, exits and doors: cause, levels and segments of each."""
        found = []
        for way in self.building["portals"]:
            stairs = {self.levels[k]["stair"] for k in way["levels"]}
            stair = next(iter(stairs - {None}), None)
            if len(stairs) == 2 or stair is None:
                name = f"stair {stair!r}" if stair else f"portal {way['name']!r}"
                found.append((name, tuple(way["levels"]), tuple(map(tuple, way["segments"]))))
        for kind, of in (("exit", "exits"), ("door", "doors")):
            for way in self.building[of]:
                segments = way["segments"] if kind == "exit" else [way["segment"]]
                found.append((f"{kind} {way['name']!r}", (way["level"],), tuple(map(tuple, segments))))
        return found

    def passed(self):
        """Times at which each person passes ways, in order, with the cause, the way and the direction."""
        found, by_name = {number: [] for number in range(len(self.people))}, {}
        ways, until = self.ways(), {(person, end): level for _, end, person, level in self.stays}
        for way in self.building["portals"]:
            ends = tuple(way["levels"]), tuple(map(tuple, way["segments"]))
            by_name[way["name"]] = next((one for one in ways if one[1:] == ends), None)
        for one in self.crossings:
            # Between the pieces of a stair, a crossing has the name of the stair.
            person, time, way = int(one["person"]), float(one["time"]), by_name.get(one["portal"])
            if way is not None:
                found[person].append((time, (way[0], way, until[person, time])))
        for number, person in enumerate(self.people):
            for way in ways if person["exit_time"] else ():
                if way[0] == f"exit {person['exit']!r}":
                    found[number].append((float(person["exit_time"]), (way[0], way, 0)))
        for way in (one for one in ways if one[0].startswith("door")):
            for is_left, times in self.crossed(way[1][0], way[2][0]).items():
                for time, person in times:
                    found[person].append((time, (way[0], way, is_left)))
        return {person: sorted(own, key=lambda one: one[0]) for person, own in found.items()}

    def away(self, row):
        """Distance of who waits from the way for which they wait; infinite on other levels."""
        _, levels, segments = row[5]
        return min(distance_to(part, row[3]) for part in segments) if row[4] in levels else np.inf

    def _nearest(self, at, level):
        here = [way for way in self.ways() if level in way[1]]
        way = min(here, key=lambda one: min(distance_to(part, at) for part in one[2]))
        return way[0], way

    def crossed(self, level, segment):
        """Times of passages over a segment of a level, and who passes, to the left and to the right of it."""
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
                        found[bool(b >= 0.0)].append((before + share * (time - before), one["person"]))
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
                    found[kind, name, "to the left" if is_left else "to the right"] = [one[0] for one in times], width
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
