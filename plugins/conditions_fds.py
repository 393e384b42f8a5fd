"""Conditions of the air that FDS has computed: slice files of several meshes, planes and volumes."""

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from evac.base.arrays import FloatArray, IntArray
from evac.base.errors import ScenarioError
from evac.building.model.building import Level
from evac.conditions.quantities import QUANTITIES
from evac.conditions.source import ConditionSource, SourceScene

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

#: Names in Smokeview files, with the quantity and the factor to its unit. The flux onto a surface in radiation from all
#: sides is a quarter of the integrated intensity.
NAMES = {
    "SOOT EXTINCTION COEFFICIENT": ("extinction", 1.0),
    "EXTINCTION COEFFICIENT": ("extinction", 1.0),
    "TEMPERATURE": ("temperature", 1.0),
    "INTEGRATED INTENSITY": ("radiation", 0.25),
    **{
        f"{name} VOLUME FRACTION": (key, 1e6 if QUANTITIES[key].unit == "ppm" else 1e2) for key, name in SPECIES.items()
    },
}

#: Keys of `&SLCF` that ask for a quantity.
ASKED = {"extinction": "QUANTITY='EXTINCTION COEFFICIENT'", "temperature": "QUANTITY='TEMPERATURE'"}
ASKED |= {"radiation": "QUANTITY='INTEGRATED INTENSITY'"}
ASKED |= {key: f"QUANTITY='VOLUME FRACTION', SPEC_ID='{name}'" for key, name in SPECIES.items()}

#: Greatest distance of a plane from the heads that it stands for [m].
TOLERANCE = 0.3

#: Share of an area that counts as complete, and as enough to know that slices are meant for a level.
COMPLETE, ENOUGH = 0.995, 0.9

#: Distance of the middle of an exit from slices within which they cover it [m].
OUTSIDE = 0.1

#: Distance by which volumes of a deck extend beyond heads on stairs [m].
MARGIN = 0.5

#: Quantities whose slices a deck has.
DECK = ("extinction", "co", "co2", "o2", "temperature")


class Fds(ConditionSource):
    """Slices of a calculation with FDS: `file` is its Smokeview file (.smv), beside which the slice files are.

    On floors, the plane nearest to each head applies, which is at most 0.3 m from the mean head of the group; on
    stairs and landings, the planes above and below, linearly. Volumes are read at the head, and come first.
    """

    name = "fds"
    keys = ("file", "level", "shift")

    def open(self, scene: SourceScene) -> Sequence[str]:
        """List the slices, and check that they lie at the heads of people."""
        from evac.conditions.slices import read_slices  # only in cases with slices

        if scene.settings.file is None:
            raise ScenarioError("file: missing; name the Smokeview file (.smv) of the calculation")
        path = scene.file(scene.settings.file)
        self._building, self._levels = scene.building, scene.levels()
        self._shift = np.array(scene.settings.shift or (0.0, 0.0, 0.0))
        found = read_slices(path, frozenset(NAMES))
        blocks = [block for block in found if not block.is_vertical]
        lines = {name: f"&SLCF PBZ={_height(scene, self._levels[0]):.2f}, {ASKED[name]} /" for name in ASKED}
        if not blocks:
            seen = ", only vertical planes (PBX, PBY), which are not read" if found else ""
            raise ScenarioError(
                f"{path}: lists no horizontal or volume slices of {', '.join(list(NAMES)[:3])} or volume fractions"
                f"{seen}; add {lines['extinction']} to the deck, for example; `evac conditions deck` prints all lines"
            )
        scene.files.extend(block.path for block in blocks)
        self._blocks: dict[str, list[Block]] = {}
        for block in blocks:
            self._blocks.setdefault(NAMES[block.quantity][0], []).append(block)
        for quantity, own in self._blocks.items():
            for index in self._levels:
                _check_heights(path, scene, scene.building.levels[index], quantity, own, self._shift)
        self.last = min(float(block.times[-1]) for block in blocks)
        first = max(blocks, key=lambda block: float(block.times[0]))
        if first.times[0] > scene.settings.start + 1e-3:
            raise ScenarioError(f"{first.path}: begins at {first.times[0]:g} s; write slices from T_BEGIN on")
        self._is_level = np.zeros(len(scene.building.levels), np.bool_)
        self._is_level[self._levels] = True
        self._is_between = np.array([level.kind != "floor" for level in scene.building.levels])
        vertical = {NAMES[block.quantity][0] for block in found if block.is_vertical} - {*self._blocks}
        self._findings = [
            f"{path}: slices of {name} are vertical planes (PBX, PBY), which are not read; add {lines[name]} to the "
            "deck and run FDS again"
            for name in scene.needed
            if name in vertical
        ]
        self._findings += _coverage(scene, self._levels, self._blocks, self._shift)
        self._located: tuple[FloatArray | None, dict[tuple[tuple[bytes, ...], ...], list[_Part]]] = (None, {})
        return tuple(self._blocks)

    def findings(self) -> Sequence[str]:
        """Return how much of each level the slices cover, where that is not all of it."""
        return self._findings

    def at(
        self, quantities: Sequence[str], time: float, level: IntArray, position: FloatArray, height: FloatArray
    ) -> FloatArray:
        """Return the values at a time, linear between frames and in space."""
        found = np.full((len(quantities), len(level)), np.nan)
        if self._located[0] is not height:
            self._located = height, {}
        for row, quantity in enumerate(quantities):
            blocks = self._blocks[quantity]
            key = tuple(block.place for block in blocks)
            if key not in self._located[1]:
                self._located[1][key] = self._locate(blocks, level, position, height)
            factor, own = NAMES[blocks[0].quantity][1], QUANTITIES[quantity]
            sums = np.zeros(len(level))
            for block, rows, nodes, weights in self._located[1][key]:
                sums[rows] += factor * blocks[block].at(time, nodes, weights)
                found[row, rows] = sums[rows]
            np.clip(found[row], own.least, own.most, out=found[row])  # NaN stays
        return found

    def _locate(
        self, blocks: "list[Block]", level: IntArray, position: FloatArray, height: FloatArray
    ) -> "list[_Part]":
        """Return for each block that holds values of some people its number, their rows, nodes and weights."""
        points = np.vstack([position.T, height]) - self._shift[:, None]
        left = self._is_level[level]
        parts = []
        inside = [_within(block, points[:2]) & left for block in blocks]
        for k, block in enumerate(blocks):
            if not block.is_plane:
                here = inside[k] & left & (points[2] >= block.ends[2, 0]) & (points[2] <= block.ends[2, 1])
                left &= ~here
                parts.append((k, np.flatnonzero(here), np.ones(int(here.sum()))))
        planes = [k for k, block in enumerate(blocks) if block.is_plane]
        rows = np.flatnonzero(left)
        if planes and len(rows):
            away = np.array([blocks[k].axes[2][0] for k in planes])[:, None] - points[2, rows]
            away[~np.array([inside[k][rows] for k in planes])] = np.nan
            below = np.where(away <= 0.0, -away, np.inf)
            above = np.where(away > 0.0, away, np.inf)
            low, high = below.argmin(axis=0), above.argmin(axis=0)
            under, over = below.min(axis=0), above.min(axis=0)
            both = np.isfinite(under) & np.isfinite(over)
            share = np.where(under <= over, 0.0, 1.0)  # of the plane above: the nearest one alone
            linear = both & self._is_between[level[rows]]
            share[linear] = under[linear] / (under[linear] + over[linear])
            for number, k in enumerate(planes):
                for chosen, weight in ((low, 1.0 - share), (high, share)):
                    there = (chosen == number) & (weight > 0.0) & np.isfinite(under if chosen is low else over)
                    parts.append((k, rows[there], weight[there]))
        located = []
        for k, here, weight in parts:
            if len(here):
                nodes, weights = blocks[k].weigh(points[:, here])
                located.append((k, here, nodes, weights * weight))
        return located

    def deck(self, scene: SourceScene) -> Sequence[str]:
        """Return the lines of an input file of FDS for slices at the heads of people on all levels."""
        shift = scene.settings.shift or (0.0, 0.0, 0.0)
        lines, wanted = [], dict.fromkeys([*DECK, *scene.needed])
        heads = sorted({round(head, 2) for head in scene.heads.values()})
        chosen = [head for k, head in enumerate(heads) if k == 0 or head - heads[k - 1] > 0.01]
        floors = sorted({round(level.z_min, 2) for level in scene.building.levels if level.kind == "floor"})
        for floor in floors:
            names = [one.name for one in scene.building.levels if one.kind == "floor" and round(one.z_min, 2) == floor]
            lines.append(f"! {', '.join(names)}: heads {', '.join(f'{head:g}' for head in chosen)} m above {floor:g} m")
            for head in chosen:
                z = f"{floor + head - shift[2]:.2f}"
                lines += [f"&SLCF PBZ={z}, {ASKED[quantity]} /" for quantity in wanted]
        for level in scene.building.levels:
            if level.kind != "floor":
                x1, y1, x2, y2 = level.polygon.bounds
                box = ((x1, x2), (y1, y2), (level.z_min + heads[0], level.z_max + heads[-1]))
                ends = ",".join(
                    f"{end - move + beyond:.2f}"
                    for pair, move in zip(box, shift, strict=True)
                    for end, beyond in zip(pair, (-MARGIN, MARGIN), strict=True)
                )
                lines.append(f"! {level.name}")
                lines += [f"&SLCF XB={ends}, {ASKED[quantity]} /" for quantity in wanted]
        return [*lines, "&DUMP DT_SLCF=1., DT_SL3D=1. /"]


#: Number of a block, the rows of people whose values it holds, and the nodes and weights that give them.
_Part = tuple[int, NDArray[np.int64], NDArray[np.int64], FloatArray]


def _within(block: "Block", points: FloatArray) -> NDArray[np.bool_]:
    """Return whether points (2, n) lie in the rectangle of a block in plan."""
    low, high = block.ends[:2, :1], block.ends[:2, 1:]
    inside: NDArray[np.bool_] = np.all((points >= low) & (points <= high), axis=0)
    return inside


def _at_heads(level: Level, heads: Iterable[float], blocks: "list[Block]", shift: float) -> "list[Block]":
    """Return the blocks that apply to heads on a level: volumes, planes near them, on stairs all between planes."""
    found = []
    ends = [z + head for head in heads for z in (level.z_min, level.z_max)]
    planes = np.array([block.axes[2][0] for block in blocks if block.is_plane]) + shift
    is_between = level.kind != "floor" and len(planes) and planes.min() <= min(ends) and planes.max() >= max(ends)
    for block in blocks:
        low, high = block.ends[2] + shift
        z = block.axes[2][0] + shift
        near = any(abs(z - end) <= TOLERANCE for end in ends)
        if (near or is_between) if block.is_plane else (low <= min(ends) and high >= max(ends)):
            found.append(block)
    return found


def _ground(blocks: "Iterable[Block]", shift: FloatArray) -> BaseGeometry:
    """Return the area in plan that blocks cover."""
    return shapely.union_all([shapely.box(*(block.ends[:2].T + shift[:2]).ravel()) for block in blocks])


def _check_heights(
    path: object, scene: SourceScene, level: Level, quantity: str, blocks: "list[Block]", shift: FloatArray
) -> None:
    """Refuse a level at whose heads there are no slices although there are some below or above them."""
    whole = level.polygon.intersection(_ground(blocks, shift)).area
    for group, head in scene.heads.items():
        near = _at_heads(level, [head], blocks, shift[2])
        if level.polygon.intersection(_ground(near, shift)).area >= ENOUGH * whole:
            continue
        z = 0.5 * (level.z_min + level.z_max) + head
        planes = np.array([block.axes[2][0] for block in blocks if block.is_plane]) + shift[2]
        nearest = f"; the nearest plane is at {planes[np.abs(planes - z).argmin()]:.2f} m" if len(planes) else ""
        raise ScenarioError(
            f"{path}: level {level.name!r}: no slice of {quantity} within {TOLERANCE:g} m of z = {z:.2f} m, where the "
            f"heads of group {group!r} are{nearest}; add &SLCF PBZ={z - shift[2]:.2f}, {ASKED[quantity]} / to the deck "
            "and run FDS again, or name the levels that have slices (level)"
        )


def _height(scene: SourceScene, level: int) -> float:
    """Return the height of the heads of the first group on a level, in the coordinates of FDS [m]."""
    shift = scene.settings.shift or (0.0, 0.0, 0.0)
    return scene.building.levels[level].z_min + next(iter(scene.heads.values())) - shift[2]


def _coverage(
    scene: SourceScene, levels: list[int], blocks: "Mapping[str, list[Block]]", shift: FloatArray
) -> list[str]:
    """Return a line for each level whose area the slices do not cover, with the exits outside."""
    building, path, heads = scene.building, scene.settings.file, scene.heads.values()
    lines, covered, total = [], 0.0, 0.0
    for index in levels:
        level = building.levels[index]
        grounds = {name: _ground(_at_heads(level, heads, own, shift[2]), shift) for name, own in blocks.items()}
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
        low = np.array([building.levels[index].polygon.bounds for index in levels])
        middle = 0.5 * (low[:, :2].min(axis=0) + low[:, 2:].max(axis=0))
        own = np.array(_ground([block for each in blocks.values() for block in each], shift).bounds)
        move = middle - 0.5 * (own[:2] + own[2:]) + shift[:2]
        remedy = f"shift = [{move[0]:.2f}, {move[1]:.2f}, {shift[2]:g}] would centre the slices on the building"
        if covered == 0.0:
            raise ScenarioError(f"{path}: the slices cover nothing of the building; {remedy}")
        lines.append(f"{path}: slices cover {100.0 * covered / total:.0f} % of the building; {remedy}")
    return lines


evac_interface = 3
