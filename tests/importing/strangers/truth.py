"""Random office buildings whose rooms, doors, exits and stairs are known."""

import math
import random
from dataclasses import dataclass, field

import numpy as np
import shapely
from shapely import LineString, Polygon, box

#: Depth of a tread, width of a flight, and floor before and behind it [m].
GOING, FLIGHT, FLOOR = 0.28, 1.2, 1.4


@dataclass
class Wall:
    """A wall by the ends of its centre line, which is parallel to an axis, and what is open in it."""

    line: tuple[float, float, float, float]
    thickness: float
    outer: bool
    doors: list["Door"] = field(default_factory=list)

    @property
    def body(self):
        """The wall without openings; ends reach half the thickness beyond the centre line."""
        x1, y1, x2, y2 = self.line
        half = self.thickness / 2
        return box(x1 - half, y1 - half, x2 + half, y2 + half)

    def along(self, start, end):
        """The part of the centre line between two distances from its first end."""
        x1, y1, x2, y2 = self.line
        length = math.hypot(x2 - x1, y2 - y1)
        ux, uy = (x2 - x1) / length, (y2 - y1) / length
        return LineString([(x1 + ux * start, y1 + uy * start), (x1 + ux * end, y1 + uy * end)])


@dataclass
class Door:
    """An opening of a clear width in a wall; `kind` is door, exit or lift."""

    name: str
    kind: str
    wall: Wall
    segment: LineString
    height: float = 2.1

    @property
    def strip(self):
        """The floor within the wall."""
        return self.segment.buffer(self.wall.thickness / 2, cap_style="flat")


@dataclass
class Room:
    """A room by its clear floor, with stairs not cut out; `use` is office, corridor, stairs or lift."""

    name: str
    use: str
    polygon: Polygon


@dataclass
class Stair:
    """A stair in a stairwell: each tread (polygon, height above the lower storey), landing, and both edges."""

    lower: int
    well: str
    kind: str
    treads: list[tuple[Polygon, float]]
    landings: list[tuple[Polygon, float]]
    lower_edge: LineString
    upper_edge: LineString

    @property
    def footprint(self):
        """All that treads and landings cover in plan, with the gap between two flights."""
        return shapely.union_all([one for one, _ in self.treads + self.landings]).envelope


@dataclass
class Storey:
    """The rooms and walls of a storey."""

    name: str
    z: float
    rooms: list[Room]
    walls: list[Wall]

    @property
    def doors(self):
        """All that is open in walls."""
        return [door for wall in self.walls for door in wall.doors]

    @property
    def outline(self):
        """The outer face of the outer walls."""
        whole = shapely.union_all([wall.body for wall in self.walls] + [room.polygon for room in self.rooms])
        return Polygon(whole.exterior).simplify(1e-6)

    @property
    def wall_bodies(self):
        """All walls without their openings, from the floor to the lintels."""
        strips = [door.strip.buffer(1e-6, join_style="mitre") for door in self.doors]
        return shapely.union_all([wall.body for wall in self.walls]) - shapely.union_all(strips)

    @property
    def floor(self):
        """All rooms but lifts, with stairs not cut out."""
        return shapely.union_all([room.polygon for room in self.rooms if room.use != "lift"])


@dataclass
class Truth:
    """A building in metres, and how it is turned and moved in its file."""

    storeys: list[Storey]
    stairs: list[Stair]
    height: float
    turned: float
    moved: tuple[float, float]

    def place(self, x, y):
        """Return coordinates in the file [m]."""
        c, s = math.cos(self.turned), math.sin(self.turned)
        return c * x - s * y + self.moved[0], s * x + c * y + self.moved[1]

    def placed(self, shape):
        """Return a shape in the coordinates of the file [m]."""
        return shapely.transform(shape, lambda p: np.column_stack(self.place(*p.T)))

    def local(self, shape):
        """Return a shape of the file in the frame of the building."""
        c, s = math.cos(self.turned), math.sin(self.turned)
        back = np.array([[c, -s], [s, c]])
        return shapely.transform(shape, lambda p: (p - self.moved) @ back)

    def stairs_at(self, number):
        """The stairs that begin or end on a storey."""
        return [stair for stair in self.stairs if stair.lower in (number, number - 1)]

    def open_floor(self, number):
        """The floor of a storey without the openings of stairs from below."""
        holes = [stair.footprint for stair in self.stairs if stair.lower == number - 1]
        return self.storeys[number].floor - shapely.union_all(holes)


def building(seed, *, grid=0.0, storeys=None, lifts=True, setback=True, stairs=True, axes=False):
    """Return a random building: a corridor between two rows of rooms, and one or two stairwells at its first end.

    With `grid`, all lengths are multiples of it. Without `stairs`, each storey has exits of its own.
    """
    rng = random.Random(seed)

    def draw(low, high):
        value = rng.uniform(low, high)
        return round(round(value / grid) * grid, 6) if grid else round(value, 3)

    number = storeys or rng.randint(2, 6)
    risers = 2 * rng.randint(8, 10)
    height = round(risers * 0.17, 3)
    kind = rng.choice(["straight", "turning"])
    length = (risers - 1) * GOING if kind == "straight" else (risers // 2 - 1) * GOING + FLIGHT
    depth = length + FLOOR + (FLOOR if kind == "straight" else 0.0)
    depth = round(depth, 6) if not grid else math.ceil(depth / grid) * grid
    inner, outer = (grid * 2, grid * 3) if grid else (draw(0.1, 0.2), draw(0.24, 0.4))
    corridor = draw(1.8, 2.6)
    well = 2 * FLIGHT + 0.1 if kind == "turning" else FLIGHT + 1.3
    rows = [(0.0, depth), (depth + corridor + 2 * inner, 2 * depth + corridor + 2 * inner)]
    wells = [] if not stairs else [1, 0] if rng.random() < 0.4 else [1]
    width = draw(18, 34)
    made, flights = [], []
    for k in range(number):
        if setback and k == number - 1 and k > 1 and rng.random() < 0.5:
            width = round(width - draw(4, 7), 6)
        made.append(_storey(k, round(k * height, 6), rng, draw, width, rows, inner, outer, wells, well, lifts))
        if k + 1 < number:
            flights += [_stair(k, kind, row, rows[row], risers, height) for row in wells]
    turned = rng.choice([0.0, math.pi / 2]) if axes or grid else rng.choice([0.0, rng.uniform(0, 2 * math.pi)])
    moved = (0.0, 0.0) if rng.random() < 0.4 else (draw(-80, 80), draw(-80, 80))
    return Truth(made, flights, height, turned, moved)


def _storey(k, z, rng, draw, width, rows, inner, outer, wells, well, lifts):
    """Return a storey: outer walls, walls along the corridor, and partitions between the rooms of both rows."""
    top = rows[1][1]
    h, o = inner / 2, outer / 2
    corridor = (rows[0][1] + h, rows[1][0] - h)
    walls = [
        Wall((-o, -o, width + o, -o), outer, True),
        Wall((-o, top + o, width + o, top + o), outer, True),
        Wall((-o, -o, -o, top + o), outer, True),
        Wall((width + o, -o, width + o, top + o), outer, True),
    ]
    along = [Wall((-h, y, width + h, y), inner, False) for y in corridor]
    rooms = [Room(f"corridor {k}", "corridor", box(0, corridor[0] + h, width, corridor[1] - h))]
    partitions = []
    for row, (low, high) in enumerate(rows):
        x = 0.0
        while x < width - 0.01:
            first = x == 0.0
            is_well = first and row in wells
            is_lift = lifts and not first and row == 1 and x < 4
            end = x + (well if is_well else 1.7 if is_lift else draw(3.2, 7))
            end = width if end > width - 3.2 else round(end, 6)
            use = "stairs" if is_well else "lift" if is_lift else "office"
            room = Room(f"{use} {k}{row}{len(rooms):02d}", use, box(x, low, end, high))
            rooms.append(room)
            clear = rng.choice([0.8, 0.9, 1.0, 1.2])
            start = (x + 0.3 if rng.random() < 0.5 else end - 0.3 - clear) + h
            kind = "lift" if use == "lift" else "door"
            _open(along[row], start, 0.9 if use == "lift" else clear, f"D{k}.{len(rooms)}", kind)
            if end < width:
                partitions.append(Wall((end + h, low - h, end + h, high + h), inner, False))
                if use == "office" and rng.random() < 0.2 and end + inner < width:
                    _open(partitions[-1], draw(1, high - low - 2), 0.9, f"P{k}.{len(rooms)}", "door")
            x = round(end + inner, 6)
    if k == 0 or not wells:
        for one in rng.sample([0, 1], rng.randint(1, 2)):
            clear = rng.choice([0.9, 1.2, 1.6])
            middle = (corridor[0] + corridor[1]) / 2 + o
            _open(walls[2 + one], middle - clear / 2, clear, f"X{k}.{one}", "exit")
        hall = next(room for room in rooms if room.use == "office" and room.polygon.bounds[1] == 0.0)
        if rng.random() < 0.5:
            _open(walls[0], hall.polygon.bounds[0] + o + 0.8, 1.4, f"X{k}.2", "exit")
    return Storey(rng.choice(["Level {}", "OG {}", "{}F"]).format(k), z, rooms, walls + along + partitions)


def _open(wall, start, clear, name, kind):
    wall.doors.append(Door(name, kind, wall, wall.along(start, start + clear)))


def _stair(lower, kind, row, bounds, risers, height):
    """Return a stair that begins `FLOOR` beyond the corridor and leads away from it, and may turn back."""
    sign, start = (1, bounds[0] + FLOOR) if row else (-1, bounds[1] - FLOOR)
    riser = height / risers

    def part(x, a, b, width=FLIGHT):
        y = sorted((start + sign * a, start + sign * b))
        return box(x, y[0], x + width, y[1])

    def edge(x, a):
        return LineString([(x, start + sign * a), (x + FLIGHT, start + sign * a)])

    if kind == "straight":
        treads = [(part(0, i * GOING, (i + 1) * GOING), (i + 1) * riser) for i in range(risers - 1)]
        return Stair(lower, f"stairs {row}", kind, treads, [], edge(0, 0), edge(0, (risers - 1) * GOING))
    half = risers // 2
    length = (half - 1) * GOING
    treads = [(part(0, i * GOING, (i + 1) * GOING), (i + 1) * riser) for i in range(half - 1)]
    back = FLIGHT + 0.1
    treads += [
        (part(back, length - (i + 1) * GOING, length - i * GOING), (half + i + 1) * riser) for i in range(half - 1)
    ]
    landing = (part(0, length, length + FLIGHT, 2 * FLIGHT + 0.1), half * riser)
    return Stair(lower, f"stairs {row}", kind, treads, [landing], edge(0, 0), edge(back, 0))
