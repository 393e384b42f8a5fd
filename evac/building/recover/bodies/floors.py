"""Convert spaces, slabs, walls and columns to the floors of storeys."""

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import shapely
from shapely.geometry.base import BaseGeometry

from evac.base.defaults import HEADROOM
from evac.base.progress import track
from evac.building.geometry import common, cut, place_of, united
from evac.building.model.findings import Finding
from evac.building.recover.bodies.body import SAME_HEIGHT, Body, closed, snapped, without_slivers

#: Largest difference in height between a floor and the top of its slab, due to floor finishes [m].
THICKNESS = 0.3
#: Largest depth below the floor of a space at which a slab in it is a part of the floor below [m].
RECESS = 0.8
#: Least height of a space that people can stand in [m].
STANDING = 1.8
#: Largest difference in height between a roof and the space above it [m].
ROOF = 0.6
#: Heights above a floor at which walls and columns are cut [m].
CUTS = (0.1, 0.5, 1.0, 1.5, 1.9)
#: Furniture higher above a floor than this is not an obstacle [m].
HANGING = 1.5
#: Bodies that reach into a room by at most this are ignored as drawing inaccuracies [m].
DEPTH = 0.02
#: Ground narrower than this is dropped [m].
NARROWEST = 0.4
#: Largest gap between the opening of a door and the ground that it opens to [m].
BESIDE = 0.1
#: Minimum area of a part of a space without a slab that is reported as a void [m2].
LEAST_VOID = 0.25
#: Share of a part of the ground inside of the outer walls up to which it is outside.
OUTSIDE = 0.05
#: Words of names of spaces in which nobody can stand.
SHAFTS = """
    lift lifts elev elevator elevators hoistway shaft shafts riser duct void aufzug aufzüge liftschacht aufzugsschacht
    aufzugschacht fahrschacht installationsschacht schacht ascenseur gaine trémie ascensor ascensore vano
"""


@dataclass(frozen=True)
class Rules:
    """Assumptions about a building model; see the parameters of the importer that uses them."""

    ground: str
    exits: str
    ground_z: float
    step: float
    gap: float
    furniture: bool
    cut_slabs: bool


@dataclass
class Floor:
    """The ground at one height."""

    name: str  # name of its storey, followed by the height if the storey has several floors
    z: float  # [m]
    ground: BaseGeometry
    slabs: BaseGeometry  # tops of slabs at its height, including ground under obstacles
    # list of (str, str, polygon or multipolygon): name, use and plan of each space on it
    rooms: list[tuple[str, str, BaseGeometry]] = field(default_factory=list)


@dataclass
class _Height:
    """Plans of spaces (with names) and of slabs that form one floor, with all bodies and passages of the building."""

    z: float
    name: str = ""
    bodies: Sequence[Body] = ()
    passages: Sequence[Body] = ()
    spaces: list[tuple[Body, BaseGeometry, float]] = field(default_factory=list)
    slabs: list[BaseGeometry] = field(default_factory=list)

    @cached_property
    def walls(self) -> list[BaseGeometry]:
        """The plans of walls, columns and fillings of openings."""
        solid = [body for body in [*self.bodies, *self.passages] if body.kind in ("wall", "column", "opening")]
        level = self.z + CUTS[2]
        sections = [body.shadow for body in solid if body.z_min < level < body.z_max]
        return [plan for plan in sections if not plan.is_empty]


def floors_of(
    bodies: Sequence[Body],
    passages: Sequence[Body],
    storeys: Sequence[tuple[str, float]],
    rules: Rules,
    findings: list[Finding],
) -> list[Floor]:
    """Return the floors of a building, from bottom to top; findings are added to the list.

    `passages`: doors and openings that people pass through; `storeys` [m]: names and heights, for the names of floors.
    """
    low = _closed_spaces(bodies, findings)
    heights = _heights([body for body in bodies if body not in low], rules)
    names = _names(heights, storeys)
    floors = []
    for height, name in track("reading floors", zip(heights, names, strict=True), len(heights)):
        height.name, height.bodies, height.passages = name, bodies, passages
        slabs = united(height.slabs)
        if height.spaces and slabs.is_empty and _is_above_roof(height):
            text = "spaces with a roof and no slab below are outside of the building"
            place, number = height.spaces[0][0].place, len(height.spaces)
            findings.append(Finding("left out", text, name, place, element="space", number=number))
            continue
        if height.spaces:
            steps, halls = _in_other_spaces(height, heights), _halls(height, slabs, findings)
            made = united([_of_spaces(height, slabs, rules.gap, findings), steps, halls])
            slabs = united([slabs, steps])
        elif any(abs(body.z_min - height.z) <= THICKNESS and _covers(body.shadow, slabs) for body in low):
            continue
        else:
            if len(heights) > 1 and _is_bare(height):
                text = "no wall, door or stair stands on the slab: a roof, a terrace or a canopy"
                number = len(height.slabs)
                findings.append(Finding("left out", text, name, place_of(slabs), element="slab", number=number))
                continue
            made = slabs
            what = "the file has no spaces" if rules.ground == "auto" else "as set"
            findings.append(Finding("assumed", f"slabs without walls are used as floors: {what} (ground)", name))
        made = _inside(_without_bodies(made, height, rules.furniture), height, findings)
        spaces = sorted(height.spaces, key=lambda one: one[0].name)
        rooms = [(body.name, body.use, plan) for body, plan, _ in spaces]
        floors.append(Floor(name, height.z, made, slabs, rooms))
        levels = [z for _, _, z in height.spaces]
        if levels and max(levels) - min(levels) > 0.001:
            text = f"floors at {min(levels):z.3f} to {max(levels):z.3f} m are merged at {height.z:z.3f} m (step)"
            findings.append(Finding("assumed", text, name))
    for row, floor in enumerate(floors):
        over = [other for other in floors[row + 1 :] if other.z < floor.z + HEADROOM]
        floor.ground = cut(floor.ground, united([one for other in over for one in (other.ground, other.slabs)]))
        _drop_slivers(floor, findings)
    return [floor for floor in floors if not floor.ground.is_empty]


def _closed_spaces(bodies: Sequence[Body], findings: list[Finding]) -> list[Body]:
    """Return the spaces in which nobody can stand, such as attics and shafts; they are added to `findings`."""
    closed_to_all = []
    for body in (body for body in bodies if body.kind == "space"):
        height = body.z_max - body.z_min
        why = f"is only {height:.2f} m high: nobody can stand in it" if height < STANDING else ""
        words = set(re.findall(r"[^\W\d_]{2,}", body.name.lower()))
        why = why or ("is a shaft by its name" if words and words <= {*SHAFTS.split()} else "")
        if why:
            closed_to_all.append(body)
            place = (*body.place, body.z_min)
            findings.append(Finding("left out", f"{body.name!r} {why}", None, place, element="space"))
    return closed_to_all


def _covers(plan: BaseGeometry, other: BaseGeometry) -> bool:
    """Return whether a polygon covers at least half of another one."""
    return bool(common(plan, other).area > 0.5 * other.area)


def _is_above_roof(height: _Height) -> bool:
    """Return whether a roof ends at about the height of spaces, below at least half of their area."""
    roofs = [body.shadow for body in height.bodies if body.kind == "roof" and abs(body.z_max - height.z) < ROOF]
    return bool(roofs) and _covers(united(roofs), united([one for _, one, _ in height.spaces]))


def _is_bare(height: _Height) -> bool:
    """Return whether neither walls higher than a parapet nor doors nor stairs are at a height."""
    slabs, z = united(height.slabs), height.z
    beside = [
        body
        for body in height.bodies
        if (body.kind == "wall" and body.z_min < z + CUTS[2] and body.z_max > z + CUTS[3])
        or (body.kind in ("stair", "landing") and body.z_min - THICKNESS < z < body.z_max + THICKNESS)
    ]
    beside += [body for body in height.passages if abs(body.z_min - z) <= THICKNESS]
    return not any(shapely.dwithin(shapely.box(*body.box[:, :2].ravel()), slabs, THICKNESS) for body in beside)


def _heights(bodies: Sequence[Body], rules: Rules) -> list[_Height]:
    """Group plans whose heights differ by at most `rules.step` [m] into floors, starting from the largest."""
    ground, step = rules.ground, rules.step
    candidates: list[tuple[float, float, Body, BaseGeometry]] = []
    if ground != "slabs":
        spaces = [(body, *face) for body in bodies if body.kind == "space" for face in _lowest(body)]
        candidates += [(plan.area, z, body, plan) for body, plan, z in spaces]
    slabs = [(plan.area, z, body, plan) for body in bodies if body.kind == "slab" for plan, z in body.tops]
    heights: list[_Height] = []
    for _, z, body, plan in sorted(candidates, key=lambda one: (-one[0], one[1])):
        height = _nearest(heights, z, step)
        height.spaces.append((body, plan, z))
    for _, z, _, plan in sorted(slabs, key=lambda one: (-one[0], one[1])):
        if ground == "spaces" or any(-THICKNESS <= z - height.z <= step for height in heights if height.spaces):
            near = [height for height in heights if -THICKNESS <= z - height.z <= step]
            if near:
                min(near, key=lambda height: abs(height.z - z)).slabs.append(plan)
        else:
            _nearest(heights, z, step).slabs.append(plan)
    return sorted(heights, key=lambda height: height.z)


def _lowest(space: Body) -> list[tuple[BaseGeometry, float]]:
    """Return the level faces of a space that point downwards and have no other one of them below."""
    faces: list[tuple[BaseGeometry, float]] = []
    for plan, z in space.bottoms():
        rest = cut(plan, united([lower for lower, _ in faces])) if faces else plan
        if not rest.is_empty:
            faces.append((rest, z))
    return faces


def _nearest(heights: list[_Height], z: float, step: float) -> _Height:
    """Return the floor at a height [m]; append a new one if none is within `step`."""
    near = [height for height in heights if abs(height.z - z) <= step]
    if not near:
        near = [_Height(round(z, 3))]
        heights += near
    return min(near, key=lambda height: abs(height.z - z))


def _names(heights: Sequence[_Height], storeys: Sequence[tuple[str, float]]) -> list[str]:
    """Name floors after the storey of their spaces, or the nearest one; a storey's further floors get their height."""
    names = [""] * len(heights)
    given = [Counter(body.storey for body, _, _ in height.spaces if body.storey).most_common(1) for height in heights]
    away = sorted(
        (not own, abs(height.z - z), row, name)
        for row, (height, own) in enumerate(zip(heights, given, strict=True))
        for name, z in storeys
        if (name == own[0][0] if own else abs(height.z - z) < 1.5)
    )
    for _, _, row, name in away:
        if not names[row] and name not in names:
            names[row] = name
    for row, (height, own) in enumerate(zip(heights, given, strict=True)):
        below = [name for name, z in sorted(storeys, key=lambda one: one[1]) if z <= height.z + THICKNESS]
        if not names[row]:
            storey = own[0][0] if own else below[-1] if below else "floor"
            names[row] = f"{storey} z={height.z:z.2f}"
    return names


def _of_spaces(height: _Height, slabs: BaseGeometry, gap: float, findings: list[Finding]) -> BaseGeometry:
    """Return the part of the spaces that has a slab below it."""
    plan = united([closed(united([one for _, one, _ in height.spaces]), gap)])
    if slabs.is_empty:
        text = "no slab is at the height of the spaces; all spaces are used as floors"
        findings.append(Finding("assumed", text, height.name))
        return plan
    void = without_slivers(cut(plan, slabs), 2 * THICKNESS)
    for part in shapely.get_parts(void):
        if part.area > LEAST_VOID:
            text = f"{part.area:.2f} m2 of space without a slab below are a void"
            findings.append(Finding("left out", text, height.name, place_of(part)))
            plan = cut(plan, part)
    return plan


def _in_other_spaces(height: _Height, heights: Sequence[_Height]) -> BaseGeometry:
    """Return the slabs at a height that are in spaces of other floors: recesses and landings of a hall, for example."""
    spaces = [
        plan
        for other in heights
        for body, plan, z in other.spaces
        if other is not height and z - RECESS <= height.z < body.z_max
    ]
    tops = [top for body in height.bodies if body.kind == "slab" for top in body.tops]
    here = [plan for plan, z in tops if abs(z - height.z) <= SAME_HEIGHT]
    over = [plan for plan, z in tops if SAME_HEIGHT < z - height.z < STANDING]
    own = [plan for _, plan, _ in height.spaces]
    return without_slivers(cut(common(united(here), united(spaces)), united([*over, *own])), NARROWEST)


def _halls(height: _Height, slabs: BaseGeometry, findings: list[Finding]) -> BaseGeometry:
    """Return the slabs that walls and spaces enclose without a space on them, if several doors open there."""
    around = united([*height.walls, *(plan for _, plan, _ in height.spaces)])
    enclosed = [shapely.Polygon(ring) for part in shapely.get_parts(around) for ring in part.interiors]
    doors = [body.shadow for body in height.passages if -THICKNESS <= body.z_min - height.z <= RECESS]
    halls = []
    for hall in (hall for ring in enclosed for hall in shapely.get_parts(common(ring, slabs))):
        if hall.area > LEAST_VOID and sum(hall.distance(door) < BESIDE for door in doors) > 1:
            halls.append(hall)
            text = f"{hall.area:.2f} m2 of slab between doors are used as a floor without a space"
            findings.append(Finding("assumed", text, height.name, place_of(hall)))
    return united(halls)


def _inside(ground: BaseGeometry, height: _Height, findings: list[Finding]) -> BaseGeometry:
    """Return the ground without terraces: parts outside of the walls to which no stair leads."""
    walls = closed(united(height.walls), THICKNESS)
    hull = united([shapely.Polygon(part.exterior) for part in shapely.get_parts(walls)])
    parts = shapely.get_parts(ground)
    shares = shapely.area(shapely.intersection(parts, hull)) / shapely.area(parts)
    if common(ground, hull).area <= 0.5 * hull.area:
        return ground
    stairs = [body for body in height.bodies if body.kind in ("stair", "landing")]
    stairs = [body for body in stairs if body.z_min - THICKNESS < height.z < body.z_max + THICKNESS]
    ways = united([shapely.box(*body.box[:, :2].ravel()) for body in stairs])
    is_outside = (shares < OUTSIDE) & ~shapely.dwithin(parts, ways, THICKNESS)
    for part in parts[is_outside]:
        text = f"{part.area:.2f} m2 outside of the walls, such as a terrace: doors to it lead outside"
        findings.append(Finding("left out", text, height.name, place_of(part)))
    return united(parts[~is_outside])


def _without_bodies(ground: BaseGeometry, height: _Height, furniture: bool) -> BaseGeometry:
    """Return the ground without walls, columns, furniture and the fillings of openings in walls."""
    away = []
    for body in height.bodies:
        if body.z_max <= height.z + CUTS[0] or body.z_min >= height.z + CUTS[-1]:
            continue
        if body.kind in ("wall", "column"):
            away += body.sections([height.z + above for above in CUTS])
        elif body.kind == "opening" and body.z_min <= height.z + THICKNESS:
            corners = body.rectangle()
            away += [] if corners is None else [shapely.Polygon(corners)]
        elif body.kind == "furniture" and furniture and body.z_min < height.z + HANGING:
            away.append(body.shadow)
    solid = common(ground, united(away))
    deep = shapely.buffer(shapely.buffer(solid, -DEPTH / 2, join_style="mitre"), DEPTH / 2, join_style="mitre")
    return cut(ground, deep) if height.spaces else cut(ground, united(away))


def _drop_slivers(floor: Floor, findings: list[Finding]) -> None:
    """Drop the parts of a floor that are too narrow to stand in."""
    kept = without_slivers(floor.ground, NARROWEST)
    dropped = [part for part in shapely.get_parts(cut(floor.ground, kept)) if part.area > 1e-3]
    if dropped:
        text = f"{len(dropped)} pieces of floor narrower than {NARROWEST:g} m, {sum(p.area for p in dropped):.2f} m2"
        place = place_of(max(dropped, key=lambda part: part.area))
        findings.append(Finding("left out", f"{text}, the largest here", floor.name, place))
    floor.ground = snapped(kept)
