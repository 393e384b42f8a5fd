"""Conditions of the air that FDS has computed: slice files of several meshes, planes and volumes."""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from evac.base.arrays import FloatArray, IntArray
from evac.base.errors import ScenarioError
from evac.base.parameters import Parameter
from evac.building.model.building import Level
from evac.conditions.source import HOTTEST_START, QUANTITIES, ConditionSource, SourceScene

if TYPE_CHECKING:
    from evac.conditions.slices import Block

#: Species of FDS by the name of the quantity.
SPECIES = {
    "co": "CARBON MONOXIDE",
    "co2": "CARBON DIOXIDE",
    "o2": "OXYGEN",
    "hcn": "HYDROGEN CYANIDE",
    "no": "NITRIC OXIDE",
    "no2": "NITROGEN DIOXIDE",
    "hcl": "HYDROGEN CHLORIDE",
    "hbr": "HYDROGEN BROMIDE",
    "hf": "HYDROGEN FLUORIDE",
    "so2": "SULFUR DIOXIDE",
    "acrolein": "ACROLEIN",
    "formaldehyde": "FORMALDEHYDE",
}

#: Names of visibility, which is read where there is no extinction coefficient: VISIBILITY_FACTOR over the coefficient,
#: at most MAXIMUM_VISIBILITY, the values of FDS unless its input file has others; air of that visibility is clear [m].
VISIBILITY = ("SOOT VISIBILITY", "VISIBILITY")
VISIBILITY_FACTOR, MAXIMUM_VISIBILITY = 3.0, 30.0

#: Names in Smokeview files, with the quantity and the factor to its unit. The flux onto a surface in radiation from all
#: sides is a quarter of the integrated intensity.
NAMES = {
    "SOOT EXTINCTION COEFFICIENT": ("extinction", 1.0),
    "EXTINCTION COEFFICIENT": ("extinction", 1.0),
    **dict.fromkeys(VISIBILITY, ("extinction", 1.0)),
    "TEMPERATURE": ("temperature", 1.0),
    "INTEGRATED INTENSITY": ("radiation", 0.25),
    **{
        f"{name} VOLUME FRACTION": (key, 1e6 if QUANTITIES[key].unit == "ppm" else 1e2) for key, name in SPECIES.items()
    },
}

#: Units of these quantities in Smokeview files; fractions are in the last one.
UNITS = {"extinction": ("1/m",), "visibility": ("m",), "temperature": ("C",), "radiation": ("kW/m2", "kW/m^2")}
FRACTION = ("mol/mol",)

#: By how much values may pass the bounds of their quantity, and are clipped: of fractions, 1e-4, of others 0.01 in
#: their unit, since FDS passes them by such amounts.
SLACK = 1e-4, 0.01

#: Keys of `&SLCF` that ask for a quantity.
ASKED = {"extinction": "QUANTITY='EXTINCTION COEFFICIENT'", "temperature": "QUANTITY='TEMPERATURE'"}
ASKED |= {"radiation": "QUANTITY='INTEGRATED INTENSITY'"}
ASKED |= {key: f"QUANTITY='VOLUME FRACTION', SPEC_ID='{name}'" for key, name in SPECIES.items()}

#: Distance of a plane from the heads that it stands for, from which on that is told, and the greatest one [m].
TOLERANCE, FARTHEST = 0.3, 3.0

#: Share of an area that counts as complete, and as enough to know that slices are meant for a level.
COMPLETE, ENOUGH = 0.995, 0.9

OUTSIDE = 0.1  #: Distance of the middle of an exit from slices within which they cover it [m].
MARGIN = 0.5  #: Distance by which volumes of a deck extend beyond heads on stairs [m].
DECK = dict.fromkeys(("extinction", "co", "co2", "o2", "temperature"))  #: Quantities whose slices a deck has.


class Fds(ConditionSource):
    """Slices of a simulation with FDS: `file` is its Smokeview file (.smv), beside which the slice files are.

    On floors, the plane nearest to each head is read, at most `within` from the mean head of the group. On stairs and
    landings, values are linear between the planes above and below. Volumes, which have priority over planes, are read
    at the head. SOOT VISIBILITY is read where there is no extinction coefficient.
    """

    name = "fds"
    keys = ("file", "level", "shift")
    within = Parameter(
        TOLERANCE,
        "greatest distance of a plane from heads; a warning tells of planes beyond 0.3 m",
        "m",
        minimum=0.0,
        maximum=FARTHEST,
    )

    def open(self, scene: SourceScene) -> Sequence[str]:
        """List the slices, and check that they lie at the heads of people."""
        from evac.conditions.slices import read_slices  # only in cases with slices

        if scene.settings.file is None:
            raise ScenarioError("file: missing; name the Smokeview file (.smv) of the calculation")
        path = scene.file(scene.settings.file)
        levels, shift = scene.levels(), scene.settings.shift
        slices = read_slices(path, frozenset(NAMES), shift)
        blocks = [block for block in slices if not block.is_vertical]
        extinction = [block for block in blocks if NAMES[block.quantity][0] == "extinction"]
        if not all(block.quantity in VISIBILITY for block in extinction):
            blocks = [block for block in blocks if block.quantity not in VISIBILITY]
        if not blocks:
            seen = ", only vertical planes (PBX, PBY), which are not read" if slices else ""
            raise ScenarioError(
                f"{path}: lists no horizontal or volume slices of {', '.join(list(NAMES)[:3])} or volume fractions"
                f"{seen}; add {_line(scene, levels[0], 'extinction')} to the deck, for example; "
                "`evac conditions deck` prints all lines"
            )
        scene.files.extend(block.path for block in blocks)
        self._blocks: dict[str, list[Block]] = {}
        for block in blocks:
            self._blocks.setdefault(NAMES[block.quantity][0], []).append(block)
        for quantity, own in self._blocks.items():
            for index in levels:
                _check_heights(path, scene, scene.building.levels[index], quantity, own, self.within)
        for block in blocks:
            _check_values(block)
        self.last = min(float(block.times[-1]) for block in blocks)
        first = max(blocks, key=lambda block: float(block.times[0]))
        if first.times[0] > scene.settings.start + 1e-3:
            raise ScenarioError(f"{first.path}: begins at {first.times[0]:g} s; write slices from T_BEGIN on")
        self._places = b"", b"", b""
        self._located: dict[tuple[tuple[bytes, ...], ...], list[_Part]] = {}
        self._is_level = np.isin(np.arange(len(scene.building.levels)), levels)
        self._is_between = np.array([level.kind != "floor" for level in scene.building.levels])
        vertical = {NAMES[block.quantity][0] for block in slices if block.is_vertical} - {*self._blocks}
        self._findings = [
            f"{path}: slices of {name} are vertical planes (PBX, PBY), which are not read; add "
            f"{_line(scene, levels[0], name)} to the deck and run FDS again"
            for name in scene.needed
            if name in vertical
        ]
        self._findings += _coverage(scene, levels, self._blocks, self.within)
        self._findings += _distances(path, scene, levels, self._blocks, self.within)
        return tuple(self._blocks)

    def findings(self) -> Sequence[str]:
        """Return how much of each level the slices cover, where that is not all of it."""
        return self._findings

    def at(
        self, quantities: Sequence[str], time: float, level: IntArray, position: FloatArray, height: FloatArray
    ) -> FloatArray:
        """Return the values at a time, linear between frames and in space."""
        values = np.full((len(quantities), len(level)), np.nan)
        places = level.tobytes(), position.tobytes(), height.tobytes()
        if places != self._places:  # the same ones again where the air is read for all times before the run
            self._places, self._located = places, {}
        for row, quantity in enumerate(quantities):
            blocks = self._blocks[quantity]
            key = tuple(block.place for block in blocks)
            if key not in self._located:
                self._located[key] = self._locate(blocks, level, position, height)
            own, sums = QUANTITIES[quantity], np.zeros(len(level))
            for block, rows, nodes, weights in self._located[key]:
                sums[rows] += blocks[block].at(time, nodes, weights)
                values[row, rows] = sums[rows]
            values[row] = _in_unit(blocks[0], values[row])
            _check_bounds(blocks[0], quantity, values[row], time)
            np.clip(values[row], own.least, own.most, out=values[row])  # NaN stays
        return values

    def _locate(
        self, blocks: "list[Block]", level: IntArray, position: FloatArray, height: FloatArray
    ) -> "list[_Part]":
        """Return for each block that holds values of some people its number, their rows, nodes and weights."""
        points, here = np.vstack([position.T, height]), self._is_level[level]
        nearest = np.full((2, len(level)), np.inf)  # distances of the planes below and above
        chosen = np.full((3, len(level)), -1)  # the planes below and above, and the volume
        for k, block in enumerate(blocks):  # one after the other, because there may be many, and many places
            inside = here & _within(block, points)
            if block.is_plane:
                away = points[2] - block.axes[2][0]
                for side, candidates in enumerate((inside & (away >= 0.0), inside & (away < 0.0))):
                    nearer = candidates & (np.abs(away) < nearest[side])
                    nearest[side, nearer], chosen[side, nearer] = np.abs(away[nearer]), k
            else:
                chosen[2, inside & (chosen[2] < 0)] = k
        below, above = nearest
        share = np.where(below <= above, 0.0, 1.0)  # of the plane above: the nearest one alone
        linear = np.isfinite(below + above) & self._is_between[level]
        share[linear] = below[linear] / (below[linear] + above[linear])
        in_volume = chosen[2] >= 0
        shares = np.stack([~in_volume * (1.0 - share), ~in_volume * share, in_volume])
        located = []
        for k in range(len(blocks)):
            own = np.where(chosen == k, shares, 0.0).sum(axis=0)
            if len(rows := np.flatnonzero(own)):
                nodes, weights = blocks[k].weigh(points[:, rows])
                located.append((k, rows, nodes, weights * own[rows]))
        return located

    def deck(self, scene: SourceScene) -> Sequence[str]:
        """Return the lines of an input file of FDS for slices at the heads of people on all levels."""
        heads = sorted({round(head, 2) for head in scene.heads.values()})
        floors: dict[float, list[str]] = {}
        places = []
        for level in scene.building.levels:
            if level.kind == "floor":
                floors.setdefault(round(level.z_min, 2), []).append(level.name)
                continue
            x1, y1, x2, y2 = level.polygon.bounds
            low, high = np.array([[x1, y1, level.z_min + heads[0]], [x2, y2, level.z_max + heads[-1]]])
            ends = np.column_stack([low - MARGIN, high + MARGIN]) - np.array(scene.settings.shift)[:, None]
            places.append((level.name, [f"XB={','.join(f'{end:.2f}' for end in ends.ravel())}"]))
        planes = [
            (
                f"{', '.join(names)}: heads {', '.join(f'{head:g}' for head in heads)} m above {z:g} m",
                [f"PBZ={z + head - scene.settings.shift[2]:.2f}" for head in heads],
            )
            for z, names in sorted(floors.items())
        ]
        lines = []
        for note, wheres in [*planes, *places]:
            lines += [f"! {note}"]
            lines += [
                f"&SLCF {where}, {ASKED[name]} /"
                for where in wheres
                for name in {**DECK, **dict.fromkeys(scene.needed)}
            ]
        return [*lines, "&DUMP DT_SLCF=1., DT_SL3D=1. /"]


#: Number of a block, the rows of people whose values it holds, and the nodes and weights that give them.
_Part = tuple[int, NDArray[np.int64], NDArray[np.int64], FloatArray]


def _check_values(block: "Block") -> None:
    """Refuse another unit than that of FDS, and values at the first and last time that the quantity cannot have."""
    quantity, _ = NAMES[block.quantity]
    units = UNITS.get("visibility" if block.quantity in VISIBILITY else quantity, FRACTION)
    if block.unit not in units:
        raise ScenarioError(
            f"{block.path}: {block.quantity} is in {block.unit!r} in the Smokeview file, not in {units[0]}; "
            "write the slices as FDS does"
        )
    for index in (0, len(block.times) - 1):
        values = _in_unit(block, block.frame(index))
        _check_bounds(block, quantity, values, block.times[index])
        if quantity == "temperature" and index == 0 and values.min() > HOTTEST_START:
            raise ScenarioError(
                f"{block.path}: t = {block.times[0]:g} s: the air is at {values.min():.1f} C or more everywhere: "
                "these are kelvin; write the values in degrees Celsius, as FDS does"
            )


def _in_unit(block: "Block", values: FloatArray) -> FloatArray:
    """Return values of a block in the unit of their quantity; NaN stays."""
    if block.quantity not in VISIBILITY:
        scaled: FloatArray = NAMES[block.quantity][1] * values
        return scaled
    with np.errstate(divide="ignore"):
        return np.where(values >= MAXIMUM_VISIBILITY * (1.0 - 1e-6), 0.0, VISIBILITY_FACTOR / values)


def _check_bounds(block: "Block", quantity: str, values: FloatArray, time: float) -> None:
    """Refuse values [unit of the quantity] that it cannot have; NaN are none."""
    own = QUANTITIES[quantity]
    slack = SLACK[0] * own.most if own.unit in ("%", "ppm") else SLACK[1]
    wrong = values[(values < own.least - slack) | (values > own.most + slack)]
    if len(wrong):
        raise ScenarioError(
            f"{block.path}: t = {time:g} s: {block.quantity} gives {wrong[0]:g} {own.unit}, outside [{own.least:g}, "
            f"{own.most:g}]; the file is damaged, or not in the unit of FDS: run FDS again"
        )


def _within(block: "Block", points: FloatArray) -> NDArray[np.bool_]:
    """Return whether points (3, n) lie in a block, or above or below a plane."""
    axes = 2 if block.is_plane else 3
    low, high = block.ends[:axes, :1], block.ends[:axes, 1:]
    inside: NDArray[np.bool_] = np.all((points[:axes] >= low) & (points[:axes] <= high), axis=0)
    return inside


def _at_heads(level: Level, heads: Iterable[float], blocks: "list[Block]", within: float) -> "list[Block]":
    """Return the blocks that apply to heads on a level: volumes, planes near them, on stairs all between planes."""
    ends = np.array([z + head for head in heads for z in (level.z_min, level.z_max)])
    planes = [block.axes[2][0] for block in blocks if block.is_plane]
    is_between = level.kind != "floor" and planes and min(planes) <= ends.min() and max(planes) >= ends.max()
    return [
        block
        for block in blocks
        if (
            is_between or np.abs(block.axes[2][0] - ends).min() <= within
            if block.is_plane
            else block.ends[2, 0] <= ends.min() and block.ends[2, 1] >= ends.max()
        )
    ]


def _ground(blocks: "Iterable[Block]") -> BaseGeometry:
    """Return the area in plan that blocks cover."""
    return shapely.union_all([shapely.box(*block.ends[:2].T.ravel()) for block in blocks])


def _line(scene: SourceScene, level: int, quantity: str, head: float | None = None) -> str:
    """Return the line of the deck for a quantity at heads on a level, by default those of the first group."""
    own = scene.building.levels[level]
    z = 0.5 * (own.z_min + own.z_max) + (next(iter(scene.heads.values())) if head is None else head)
    return f"&SLCF PBZ={z - scene.settings.shift[2]:.2f}, {ASKED[quantity]} /"


def _check_heights(
    path: object, scene: SourceScene, level: Level, quantity: str, blocks: "list[Block]", within: float
) -> None:
    """Refuse a level at whose heads there are no slices although there are some below or above them."""
    whole = level.polygon.intersection(_ground(blocks)).area
    for group, head in scene.heads.items():
        if level.polygon.intersection(_ground(_at_heads(level, [head], blocks, within))).area >= ENOUGH * whole:
            continue
        z = 0.5 * (level.z_min + level.z_max) + head
        planes = np.array([block.axes[2][0] for block in blocks if block.is_plane])
        away = float(np.abs(planes - z).min()) if len(planes) else math.inf
        nearest = f"; the nearest plane is at {planes[np.abs(planes - z).argmin()]:.2f} m" if len(planes) else ""
        farther = f", or read that plane (within = {math.ceil(10.0 * away) / 10.0:g})" if away <= FARTHEST else ""
        raise ScenarioError(
            f"{path}: level {level.name!r}: no slice of {quantity} within {within:g} m of z = {z:.2f} m, where the "
            f"heads of group {group!r} are{nearest}; add {_line(scene, level.index, quantity, head)} to the deck "
            f"and run FDS again, name the levels that have slices (level){farther}"
        )


def _distances(
    path: object, scene: SourceScene, levels: list[int], blocks: "Mapping[str, list[Block]]", within: float
) -> Iterator[str]:
    """Yield a line for each floor whose planes are read farther than `TOLERANCE` from the heads of a group."""
    for level in (scene.building.levels[index] for index in levels):
        for group, head in scene.heads.items() if level.kind == "floor" else ():
            read: dict[float, list[str]] = {}  # quantities by the distance of their planes
            for quantity, own in blocks.items():
                away = [block.axes[2][0] - level.z_min - head for block in own if block.is_plane]
                if away and TOLERANCE < abs(above := min(away, key=abs)) <= within:
                    read.setdefault(round(above, 2), []).append(quantity)
            for above, quantities in read.items():
                side, air = ("above", "worse") if above > 0.0 else ("below", "better")
                yield (
                    f"{path}: level {level.name!r}: {', '.join(quantities)} are those {abs(above):.2f} m {side} the "
                    f"heads of group {group!r}, where the air may be {air}"
                )


def _coverage(scene: SourceScene, levels: list[int], blocks: "Mapping[str, list[Block]]", within: float) -> list[str]:
    """Return a line for each level whose area the slices do not cover, with the exits outside."""
    building, path, heads = scene.building, scene.settings.file, scene.heads.values()
    lines, covered, total = [], 0.0, 0.0
    for index in levels:
        level = building.levels[index]
        grounds = {name: _ground(_at_heads(level, heads, own, within)) for name, own in blocks.items()}
        areas = {name: level.polygon.intersection(ground).area for name, ground in grounds.items()}
        least = min(areas, key=areas.__getitem__)
        covered, total = covered + max(areas.values()), total + level.polygon.area
        middles = {
            one.name: shapely.points(one.segments.reshape(-1, 2).mean(axis=0)) for one in building.exits_of(index)
        }
        outside = [name for name, middle in middles.items() if not grounds[least].dwithin(middle, OUTSIDE)]
        if areas[least] < COMPLETE * level.polygon.area or outside:
            share = 100.0 * areas[least] / level.polygon.area
            of = f" of {least}" if max(areas.values()) > areas[least] else ""
            exits = f"; exits outside: {', '.join(outside)}" if outside else ""
            lines.append(f"{path}: slices{of} cover {share:.0f} % of level {level.name!r}{exits}")
    if covered < ENOUGH * total:
        bounds = np.array([building.levels[index].polygon.bounds for index in levels])
        middle = 0.5 * (bounds[:, :2].min(axis=0) + bounds[:, 2:].max(axis=0))
        own = np.array(_ground(block for each in blocks.values() for block in each).bounds)
        x, y = middle - 0.5 * (own[:2] + own[2:]) + scene.settings.shift[:2]
        remedy = f"shift = [{x:.2f}, {y:.2f}, {scene.settings.shift[2]:g}] would centre the slices on the building"
        if covered == 0.0:
            raise ScenarioError(f"{path}: the slices cover nothing of the building; {remedy}")
        lines.append(f"{path}: slices cover {100.0 * covered / total:.0f} % of the building; {remedy}")
    return lines
