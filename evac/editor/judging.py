"""Findings of `evac check` on a plan that is being drawn, and the building of its valid parts."""

import base64
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import shapely

from evac.base.arrays import FloatArray
from evac.base.errors import BuildingError, EvacError
from evac.building.model.building import Building, Door, Exit, Level
from evac.building.model.findings import PART, Finding, findings_of, numbered_rows
from evac.building.model.links import levels_reaching
from evac.building.options import BuildingOptions
from evac.building.plan.plantable import plan_of
from evac.building.surface.build import build_building, check_exits
from evac.case.loading import case_from
from evac.contract.registry import Registry
from evac.people.groups import check_people
from evac.people.places import with_places
from evac.replay.geometry import building_for_page
from evac.simulation.assembly import make_building, read_storeys


def judge(
    file: Path,
    case_file: Path | None,
    table: Mapping[str, Any] | None,
    content: Mapping[str, Any] | None,
    plugins: Sequence[Path] = (),
) -> dict[str, Any]:
    """Return the findings about a plan as `evac check` numbers them, and the building for the page if there is one.

    `file`: where the plan is; `case_file`: the case that uses it, and `content`: what is in it. Without a `table` the
    building of the case is no plan. `plugins`: files of plugins besides the installed ones.
    """
    start, told, building = time.perf_counter(), list[Finding](), None
    case, options = None, BuildingOptions()
    try:
        if case_file is not None and content is not None:
            case = case_from(content, case_file, plugin_files=plugins)
            options = case.building
    except EvacError as error:
        told += findings_of(error, case_file)
    try:
        if table is not None:
            plan = plan_of(table, file, file.parent, "building.plan." if file == case_file else "")
            registry = Registry(plugins) if case is None else case.registry
            building = build_building(read_storeys(plan, registry).surface(), file, options, need_exit=False)
            told += [*building.findings, *check_exits(building)]
        elif case is not None:
            building = make_building(case)
            told += building.findings
        if case is not None and building is not None:
            check_people(case, with_places(case, building))
    except EvacError as error:
        told += findings_of(error, file)
        if building is None and isinstance(error, BuildingError) and error.building is not None:
            building = error.building
    return {
        "errors": sum(one.kind == "error" for one in told),
        "findings": numbered_rows(told),
        "building": None if building is None else _drawn(building),
        "seconds": round(time.perf_counter() - start, 3),
    }


def storeys_of(building: Building) -> list[str]:
    """Return the storey of each level, by its name in the plan; that of a stair is the one from which it leads up."""
    found = dict[int, str]()
    for _, levels in building.storeys:
        floors = [level for level in levels if level.kind == "floor"] or levels
        names = {one.index: (one if one.kind == "floor" else floors[0]).name for one in levels}
        found |= {index: PART.sub("", name) for index, name in names.items()}
    return [found[level.index] for level in building.levels]


def floors_of(building: Building) -> list[dict[str, Any]]:
    """Return name and height of the storeys of a building that is no plan."""
    floors = [level for _, levels in building.storeys[::-1] for level in levels if level.kind == "floor"]
    return [{"name": name, "z": z} for name, z in {PART.sub("", one.name): one.z_min for one in floors}.items()]


def _drawn(building: Building) -> dict[str, Any]:
    """Return a building as the page draws it in plan [m], and as the replay draws it in 3D."""
    origin = np.round(building.vertices[:, :2].mean(axis=0))
    page, floors = building_for_page(building, origin)
    ends = [way for way in building.exits if building.is_open(way)]
    reached = levels_reaching(building.for_ways, ends) if ends else set()
    storeys = storeys_of(building)
    lines: dict[str, list[tuple[Door | Exit, FloatArray]]] = {
        "doors": [(door, door.segment) for door in building.doors],
        "exits": [(way, way.segments) for way in building.exits],
    }
    return {
        "levels": [_level(level, storeys[level.index], level.index in reached) for level in building.levels],
        "segments": {
            section: [
                {"name": one.name, "storey": storeys[one.level], "ends": np.round(line, 3).reshape(-1, 4).tolist()}
                for one, line in own
            ]
            for section, own in lines.items()
        },
        "three": {"building": page, "floors": base64.b64encode(floors.tobytes()).decode(), "origin": origin.tolist()},
    }


def _level(level: Level, storey: str, is_reached: bool) -> dict[str, Any]:
    rings = [
        [np.round(shapely.get_coordinates(ring), 3).tolist() for ring in (part.exterior, *part.interiors)]
        for part in shapely.get_parts(level.polygon)
    ]
    return {
        "storey": storey,
        "kind": level.kind,
        "stair": level.stair,
        "uphill": np.round(level.uphill, 4).tolist(),
        "reached": is_reached,
        "polygons": rings,
    }
