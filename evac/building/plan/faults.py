"""The surface and the building of a plan, or all its errors in one pass, with remedies that have been tried out."""

import copy
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from evac.base.errors import BuildingError
from evac.building.model.building import Building
from evac.building.model.findings import OWN, Finding, keyed, refusal
from evac.building.options import BuildingOptions, SurfaceOptions
from evac.building.plan.drawing import Drawing
from evac.building.plan.plan import Item, Plan
from evac.building.plan.plantable import PIECES, plan_of, table_of
from evac.building.plan.remedies import changes_of_drawn, changes_of_piece, names_like, remedy_of
from evac.building.plan.rooms import key_of, originals
from evac.building.surface.build import build_building
from evac.building.surface.surfacemesh import SurfaceMesh

#: Sections of a plan for whose items remedies are tried.
MENDED = ("rooms", "stairs", "shafts", "doors", "exits", "openings", "areas", "obstacles", "lifts")
#: Distance from a segment within which a trial has the rooms and doors of its storey [m]: all take longer.
NEARBY = 10.0


def build(plan: Plan, source: Path, options: BuildingOptions, *, need_exit: bool = True) -> Building:
    """Return the building of a plan; see `evac.building.plan.plan.Plan.building`. `source`: its name in messages."""
    drawn = DrawnPlan(plan, source, options)
    building, errors = _built(drawn.drawing.plan, drawn.mesh, source, options, need_exit=need_exit)
    if building is None:
        wrong, rest = {error.item for error in errors}, copy.copy(plan)
        for section in MENDED:
            setattr(rest, section, [one for one in getattr(plan, section) if f"{section}.{one.name}" not in wrong])
        left = Drawing(rest)
        raise drawn.refused(errors, _built(left.plan, left.mesh(), source, drawn.options)[0])
    return building


class DrawnPlan:
    """A plan that has been drawn without errors; else all are raised with the building of what is right in it."""

    def __init__(self, plan: Plan, source: Path, options: SurfaceOptions) -> None:
        self.source, self.drawing = source, Drawing(plan)
        self.plan = self.drawing.given
        # A trial may not have the storeys of exits and others in the options.
        self.options = BuildingOptions(**options.model_dump(include=set(SurfaceOptions.model_fields)))
        mesh = self.drawing.mesh()
        if mesh is None or self.drawing.errors:
            building, built = _built(self.drawing.plan, mesh, source, self.options)
            # What is left out may cause errors of the building that are not about a single item.
            faulty = {error.item for error in self.drawing.errors} | {None}
            raise self.refused([*self.drawing.errors, *(one for one in built if one.item not in faulty)], building)
        if any(one.kind == "warning" and not one.remedy and one.item for one in self.drawing.findings):
            mesh = replace(mesh, findings=self._with_remedies(self.drawing.findings, self.drawing.plan.doors))
        self.mesh = mesh

    def refused(self, errors: Sequence[Finding], building: Building | None = None) -> BuildingError:
        """Return one error with all errors, their remedies, and the building of what is right in the plan."""
        plan = self.drawing.plan
        if self.drawing.declared - {*plan.storeys}:  # stairs of flights and landings do not lead to what is left out
            loose = {f"stairs.{stair}" for stair, *_ in plan.pieces}
            errors = [one for one in errors if not (one.item or "").startswith((*loose,))]
        wrong = {error.item for error in errors}
        doors = [door for door in self.drawing.plan.doors if key_of("doors", door) not in wrong]
        error = refusal(self.source, self._with_remedies(errors, doors))
        error.building = building
        return error

    def _with_remedies(self, findings: Sequence[Finding], doors: list[Item]) -> list[Finding]:
        """Return findings with remedies of the errors and warnings among them; `doors`: those that are right."""
        doors, mended, known = list(doors), list[Finding](), dict[tuple[str | None, str], str]()
        table = table_of(self.plan)
        for one in findings:
            same = one.item, _kind_of(one)  # as on every storey of a shaft
            if one.kind not in ("error", "warning") or (same in known and not one.remedy):
                mended.append(replace(one, remedy=one.remedy or known.get(same, "")))
                continue
            section, _, name = (one.item or "").partition(".")
            given = [row for row in table.get(section, ()) if row["name"] == name] if section in MENDED else []
            found = [one]
            stairs = [stair for stair, *_ in self.plan.pieces if f"{name} ".startswith(f"{stair} ")]
            if one.kind == "error" and stairs and not given and section in ("stairs", *PIECES):
                found = [self._of_piece(one, table, max(stairs, key=len))]
            elif given and not one.remedy:
                found = self._chain(one, section, given[0], doors, {_kind_of(one)})
            known[same] = found[0].remedy
            mended += found
        return mended

    def _chain(
        self, error: Finding, section: str, row: dict[str, Any], doors: list[Item], known: set[str]
    ) -> list[Finding]:
        """Return an error and those of its item that follow it, each with a change that removes it."""
        # A change that leads to an error of a kind that is known is no way. Other errors of an item are found after
        # those of the names in it, also if nothing mends them.
        names, later = names_like(self.plan, self.drawing, row), list[tuple[dict[str, Any], Finding]]()
        for change in [*names, *changes_of_drawn(self.plan, self.drawing, section, row, error.text)]:
            again = self._tried(section, str(error.item).partition(".")[2], {**row, **change}, doors)
            if again is None:
                return [replace(error, remedy=remedy_of(row, {**row, **change}))]
            if again.kind == error.kind == "error" and again.item == error.item and _kind_of(again) not in known:
                later.append((change, again))
        found: list[Finding] = []
        for change, again in later:
            further = self._chain(again, section, {**row, **change}, doors, known | {_kind_of(again)})
            is_mended = further[-1].remedy != "remove it"
            if is_mended or (change in names and not found):
                found = [replace(error, remedy=remedy_of(row, {**row, **change})), *further]
            if is_mended:
                break
        return found or [replace(error, remedy="remove it" if error.kind == "error" else "")]

    def _of_piece(self, error: Finding, table: Mapping[str, Any], stair: str) -> Finding:
        """Return an error of a stair of flights and landings as one of the piece whose change removes it."""
        found = [(0, error)]
        kept = {own: table[own] for own in ("headroom", "storeys", "rooms") if own in table}
        kept |= {own: [row for row in table.get(own, ()) if row["stair"] == stair] for own in PIECES}
        every = [(section, row) for section in PIECES for row in kept[section]]
        for section, row in every:
            for change in changes_of_piece(self.plan, section, row, [one for _, one in every if one is not row]):
                pieces = [{**row, **change} if one is row else one for one in kept[section]]
                drawing = Drawing(plan_of({**kept, section: pieces}, self.source, Path()))
                building = _built(drawing.plan, drawing.mesh(), self.source, self.options)[0]
                if building is not None and not drawing.errors:
                    item, remedy = f"{section}.{table[section].index(row)}", remedy_of(row, {**row, **change})
                    found.append((len(building.portals), replace(error, item=item, remedy=remedy)))
        return max(found, key=lambda one: one[0])[1]  # with most pieces joined

    def _tried(self, section: str, name: str, row: Mapping[str, Any], doors: list[Item]) -> Finding | None:
        """Return the error or warning of an item added to a plan; a door without one joins `doors`."""
        rest, trial = self.plan, Plan(self.source, headroom=self.plan.headroom)
        trial.storeys, trial.refused = rest.storeys, rest.refused
        ends: Any = row.get("segment")
        around = shapely.LineString(ends).buffer(NEARBY) if np.shape(ends) == (2, 2) else None
        if around is not None and not self.drawing.rooms.get(row["storey"], around).intersects(around):
            around = None  # far from all ground

        def is_near(shape: BaseGeometry) -> bool:
            return around is None or bool(shape.intersects(around))

        near = {row[key] for key in ("storey", "lower", "upper") if key in row}
        if section not in ("shafts", "lifts"):
            near.update(*(originals(rest, name) for name in near.intersection(rest.storeys)))
            grounds = {name: tuple(filter(is_near, one.polygons)) for name, one in rest.storeys.items() if name in near}
            trial.storeys = {name: replace(rest.storeys[name], polygons=own) for name, own in grounds.items()}
        items: dict[str, list[Any]] = {
            "rooms": [room for room in rest.rooms if is_near(room.outline)],
            "obstacles": rest.obstacles,
            "areas": rest.areas if section == "areas" else [],
        }
        trial.lifts = [lift for lift in rest.lifts if section == "lifts" and lift.name != name]
        for kind, own in items.items():
            others = [item for item in own if (kind, item.name) != (section, name)]
            setattr(trial, kind, [item for item in others if item.storey in trial.storeys])
        try:
            getattr(trial, section.removesuffix("s"))(**row)
        except BuildingError as error:
            return Finding("error", str(error).removeprefix(f"{self.source}: "), item=f"{section}.{row['name']}")
        if section == "doors":
            known = [door for door in doors if door.storey in trial.storeys]
            trial.doors = [*(door for door in known if is_near(shapely.LineString(door.segment))), *trial.doors]
        drawing = Drawing(trial)
        mesh = drawing.mesh()
        item = f"{section}.{row['name']}"
        told = [one for one in drawing.findings if one.kind == "warning" and one.item == item]
        faults: list[Finding] = [*drawing.errors, *told]
        if mesh is not None and not faults:
            faults = _built(drawing.plan, mesh, self.source, self.options)[1]
        if mesh is not None and not faults:
            doors += [door for door in drawing.plan.doors if section == "doors" and door.name == row["name"]]
            return None
        nothing = Finding("error", "nothing can be drawn", item=item)
        return next((one for one in faults if one.item == item), [*faults, nothing][0])


def _built(
    plan: Plan, mesh: SurfaceMesh | None, source: Path, options: BuildingOptions, *, need_exit: bool = False
) -> tuple[Building | None, list[Finding]]:
    """Return the building of a mesh, or the errors that refuse it, about the items of a plan."""
    if mesh is None:
        return None, []
    named = {
        f"{section}.{one.name}": key_of(section, one)
        for section in ("stairs", "areas")
        for one in getattr(plan, section)
    }
    keys = {name: key for name, key in named.items() if name != key}
    try:
        building = build_building(mesh, source, options, need_exit=need_exit)
    except BuildingError as error:
        found = error.findings or (Finding("error", str(error).removeprefix(f"{source}: ")),)
        lowest = {f"stairs.{stair.name}": stair.lower for stair in plan.stairs}
        return None, keyed((replace(one, level=one.level or lowest.get(one.item or "")) for one in found), keys)
    return replace(building, findings=tuple(keyed(building.findings, keys)), keys=keys), []


def _kind_of(error: Finding) -> str:
    """Return the text of an error without names, numbers and places."""
    return OWN.sub("", error.text)
