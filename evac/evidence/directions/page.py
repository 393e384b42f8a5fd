"""Evidence of directions: travel times and directions against exact paths, over grid spacing and order."""

import math
import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import shapely
from scipy import ndimage

from evac.base.arrays import FloatArray
from evac.building.model.building import Building
from evac.building.plan.plan import Plan
from evac.case.schema import DirectionSettings
from evac.directions.build import build_fields
from evac.directions.fields import Fields
from evac.directions.march.marching import FastMarching
from evac.directions.quickest import Quickest
from evac.directions.routes import QUICKEST, Route
from evac.evidence.accuracy.reference import FINE, CleanWays, clean_ways, geodesics, refracted
from evac.evidence.accuracy.trajectories import order_of
from evac.evidence.evidence import Evidence, Row, new_figure, timed
from evac.evidence.scenes import plugins
from evac.evidence.verdicts import reported
from evac.simulation.assembly import read_building
from evac.standard.plans import FLOOR, Shape, across, one_storey


class TimedPlan(NamedTuple):
    """A building with one exit whose travel times at 1 m/s along the slope are known."""

    name: str
    building: Building
    level: int  # where people stand
    points: FloatArray  # (p, 2) [m]
    time: FloatArray  # (p,) [s]
    direction: FloatArray  # (p, 2): unit directions of the shortest paths
    lead: FloatArray  # (p,) [m]: see `evac.evidence.accuracy.reference.geodesics`; inf if there is only one path
    wall_distance: FloatArray  # (p,) [m]


def l_corner(points: int, generator: np.random.Generator) -> TimedPlan:
    """Return an L-shaped corridor along the axes, 2 m wide."""
    outline = shapely.Polygon([(0, 0), (8, 0), (8, 2), (2, 2), (2, 7), (0, 7)])
    return _one_level("L-corner", outline, ((8.0, 0.0), (8.0, 2.0)), points, generator)


def pillar(points: int, generator: np.random.Generator) -> TimedPlan:
    """Return a room with a square pillar, turned by 20 degrees so that no wall lies along the grid."""
    outline = shapely.box(0, 0, 8, 6) - shapely.box(3.2, 2.2, 4.8, 3.7)
    turned = shapely.affinity.rotate(outline, 20.0, origin=(0, 0))
    ends = shapely.affinity.rotate(shapely.LineString([(8, 2.5), (8, 3.5)]), 20.0, origin=(0, 0))
    start, end = ends.coords
    return _one_level("room with a pillar", turned, (start, end), points, generator)


def school_floor(points: int, generator: np.random.Generator) -> TimedPlan:
    """Return the upper floor of the shipped school, with an exit at the beginning of the stair."""
    case = plugins().get("case", "primary_school")
    building = read_building(Path(case) / "primary_school.msh")
    top = max((level for level in building.levels if level.kind == "floor"), key=lambda level: level.z_max)
    stair = next(portal for portal in building.portals if top.index in portal.levels)
    segment = stair.segments[0] if stair.levels[0] == top.index else stair.segments[0][[2, 3, 0, 1]]
    # Vertices of the mesh on straight walls are not corners of the outline.
    outline = shapely.normalize(top.polygon).simplify(1e-9)
    return _one_level("school floor", outline, (tuple(segment[:2]), tuple(segment[2:])), points, generator)


def stair(points: int, generator: np.random.Generator) -> TimedPlan:
    """Return a floor, a flight of 32 degrees beside its middle, and a floor below with the exit."""
    slope, floor = math.radians(32.0), shapely.box(0, 0, 4, 5)
    seams, door = [(4.0, 1.5, 4.0, 3.5), (7.0, 1.5, 7.0, 3.5)], (11.0, 3.6, 11.0, 4.8)
    plan = Plan()
    plan.storey("upper", floor, 3.0 * math.tan(slope))
    plan.storey("lower", shapely.box(7, 0, 11, 5))
    plan.stair("flight", "lower", across(7, 1.5, 3.5), "upper", across(4, 1.5, 3.5))
    plan.exit("exit", "lower", across(11, 3.6, 4.8))
    places = _places(floor, points, generator)
    time, direction = refracted(places, [np.array(line) for line in (*seams, door)], [1.0, 1.0 / math.cos(slope), 1.0])
    return _timed("over a stair", plan, "upper", places, time, direction, np.full(len(places), np.inf))


PLANS = (l_corner, pillar, school_floor, stair)


def _one_level(
    name: str, outline: shapely.Polygon, ends: Shape, points: int, generator: np.random.Generator
) -> TimedPlan:
    places = _places(outline, points, generator)
    known = geodesics(outline, np.array([*ends[0], *ends[1]]), places)
    return _timed(name, one_storey(outline, exits={"exit": ends}), FLOOR, places, *known)


def _timed(
    name: str, plan: Plan, storey: str, places: FloatArray, time: FloatArray, direction: FloatArray, lead: FloatArray
) -> TimedPlan:
    building = plan.building()
    level = next(level.index for level in building.levels if level.name == storey)
    walls = shapely.linestrings(building.walls[building.wall_level == level].reshape(-1, 2, 2))
    wall_distance = np.asarray(shapely.distance(shapely.points(places), shapely.multilinestrings(walls)))
    return TimedPlan(name, building, level, places, time, direction, lead, wall_distance)


def _places(polygon: shapely.Polygon, number: int, generator: np.random.Generator) -> FloatArray:
    """Return random places (number, 2), half of them within 0.4 m of the outline, none closer than 0.05 m."""
    low_x, low_y, high_x, high_y = polygon.bounds
    inner = polygon.buffer(-0.05)
    rim = inner - polygon.buffer(-0.4)
    accepted = []
    for where, wanted in ((inner, number - number // 2), (rim, number // 2)):
        shapely.prepare(where)
        places = np.zeros((0, 2))
        while len(places) < wanted:
            drawn = generator.uniform((low_x, low_y), (high_x, high_y), (4 * number, 2))
            places = np.concatenate([places, drawn[shapely.contains_xy(where, drawn)]])
        accepted.append(places[:wanted])
    return np.concatenate(accepted)


SPACINGS = (0.2, 0.1, 0.05, 0.025)
ORDERS = (1, 2)

#: Ranges of the distance to the nearest wall [m]: where no body's centre comes, beside walls, elsewhere.
RANGES = {"below 0.2 m of a wall": (0.0, 0.2), "0.2 to 0.4 m": (0.2, 0.4), "beyond 0.4 m": (0.4, np.inf)}

#: Directions are compared where any other path is longer by at least this many cells, and this far from the exit [m].
CLEAR_CELLS = 3.0
CLEAR_EXIT = 0.5

#: Clearance from walls: the greatest radius of the paper's crowds [m].
CLEARANCE = 0.25

WALKED = Route(strategy="shortest")

#: What is compared of the two solvers.
MARCH_KEYS = ("mean error [mm]", "greatest error [mm]", "time [ms]")

SECTION = "Travel times"
MARCHES = "scikit-fmm and the compiled march"
ANGLES = "Directions"


def run(evidence: Evidence) -> None:
    """Measure all parts and write the page."""
    points = 120 if evidence.quick else 600
    spacings = SPACINGS[:2] if evidence.quick else SPACINGS
    finest = 2.0 * FINE if evidence.quick else FINE  # spacing of the independent solution [m]

    @cache
    def plans() -> list[TimedPlan]:
        return [make(points, evidence.generator(make.__name__)) for make in PLANS]

    @cache
    def clean() -> list[tuple[CleanWays, ...]]:
        grids = (finest, 2.0 * finest)
        return [tuple(clean_ways(plan.building, plan.points, CLEARANCE, grid) for grid in grids) for plan in plans()]

    rows = evidence.measured(
        "fields", lambda: [row for plan in plans() for order in ORDERS for row in _time_rows(plan, spacings, order)]
    )
    marches = evidence.measured("marches", lambda: [row for plan in plans() for row in _march_rows(plan, spacings)])
    angles = evidence.measured(
        "angles",
        lambda: [
            row for plan, (fine, _) in zip(plans(), clean(), strict=True) for row in _angle_rows(plan, spacings, fine)
        ],
    )
    coarser = evidence.measured("clean_ways", lambda: _coarser_rows(plans(), clean(), _default_spacing(spacings)))
    orders = list(_order_rows(rows))
    _judge(evidence, orders, marches, angles, _default_spacing(spacings))
    evidence.show(
        "fields", __name__, angles=angles, coarser=coarser, finest=finest, marches=marches, orders=orders,
        points=points, rows=rows,
    )  # fmt: skip
    evidence.write_page(__name__)


def _default_spacing(spacings: Sequence[float]) -> float:
    return min(spacings, key=lambda spacing: abs(spacing - DirectionSettings().spacing))


def _judge(
    evidence: Evidence, orders: Sequence[Row], marches: Sequence[Row], angles: Sequence[Row], spacing: float
) -> None:
    second = [row["of the mean error"] for row in orders if row["order of the stencil"] == 2]
    text = f"{min(second):.2f} to {max(second):.2f}"
    evidence.verdict(reported("Travel times: order of the mean error, stencil of order 2", text, "-", SECTION))
    ratios = [[row[f"compiled, {key}"] / row[f"scikit-fmm, {key}"] for row in marches] for key in MARCH_KEYS]
    spans = (f"{min(some):.2f} to {max(some):.2f}" for some in ratios)
    text = "; ".join(f"{key[:-5]} {span}" for key, span in zip(MARCH_KEYS, spans, strict=True))
    evidence.verdict(reported("Compiled march divided by scikit-fmm", text, "-", MARCHES))
    nearer = sum(row["ours, mean"] <= row["np.gradient, mean"] for row in angles)
    clear = [row["with clearance, mean"] for row in angles if row["spacing [m]"] == spacing]
    text = f"{nearer} of {len(angles)}; with clearance {min(clear):.2g} to {max(clear):.2g} degrees off"
    evidence.verdict(reported("Directions more accurate than np.gradient", text, "-", ANGLES))


def _coarser_rows(plans: Sequence[TimedPlan], clean: Sequence[tuple[CleanWays, ...]], spacing: float) -> Iterator[Row]:
    for plan, (fine, coarse) in zip(plans, clean, strict=True):
        sure = (fine.to_meeting > CLEAR_CELLS * spacing) & (plan.time > CLEAR_EXIT)
        change = float(angles_between(fine.direction, coarse.direction)[sure].mean())
        yield {"plan": plan.name, "mean change [degrees]": change}


def _fields(plan: TimedPlan, spacing: float, order: int, clearance: float = 0.0) -> Fields:
    settings: Row = {"spacing": spacing, "clearance": clearance, "speeds": (1.0, 1.0, 1.0), "order": order}
    return build_fields(plan.building, [WALKED], **settings)


def _time_rows(plan: TimedPlan, spacings: Sequence[float], order: int) -> Iterator[Row]:
    """Return a row per spacing: errors of the travel times, and the time of a build (median of up to three)."""
    for spacing in spacings:
        fields = _fields(plan, spacing, order)
        spans: list[float] = []
        while len(spans) < 3 and sum(spans) < 1.0:
            start = time.perf_counter()
            _fields(plan, spacing, order)
            spans.append(time.perf_counter() - start)
        error = np.abs(fields.travel_time_at(plan.level, plan.points, 0) - plan.time)
        yield {
            "plan": plan.name,
            "order": order,
            "spacing [m]": spacing,
            "mean error [mm]": 1e3 * float(error.mean()),
            "greatest error [mm]": 1e3 * float(error.max()),
            "greatest error [cells]": float(error.max()) / spacing,
            "nodes": len(fields.packed.travel_time),
            "time [ms]": 1e3 * float(np.median(spans)),
        }


def _march_rows(plan: TimedPlan, spacings: Sequence[float]) -> Iterator[Row]:
    """Return a row per spacing: errors and times of scikit-fmm and of the compiled march, without other people."""
    route, settings = Route(strategy=QUICKEST), DirectionSettings()
    for spacing in spacings:
        fields = build_fields(plan.building, [route], spacing=spacing, clearance=0.0, speeds=(1.0, 1.0, 1.0))
        again = Quickest(fields, settings.quickest)
        compiled = again.columns[0].march
        plain = FastMarching(compiled.grids, replace(compiled.problem, is_plain=True), settings.order)
        row: Row = {"plan": plan.name, "spacing [m]": spacing, "nodes": compiled.grids.size}
        for name, solved, solver in (("scikit-fmm", fields, plain), ("compiled", again.fields, compiled)):
            error = np.abs(solved.travel_time_at(plan.level, plan.points, 0) - plan.time)
            values = 1e3 * error.mean(), 1e3 * error.max(), 1e3 * timed(solver.solve).least
            row |= {f"{name}, {key}": float(value) for key, value in zip(MARCH_KEYS, values, strict=True)}
        yield row


def _order_rows(rows: Sequence[Row]) -> Iterator[Row]:
    for plan, order in dict.fromkeys((row["plan"], row["order"]) for row in rows):
        here = [row for row in rows if row["plan"] == plan and row["order"] == order]
        spacings = [row["spacing [m]"] for row in here]
        yield {
            "plan": plan,
            "order of the stencil": order,
            "of the mean error": order_of(spacings, [row["mean error [mm]"] for row in here]),
            "of the greatest error": order_of(spacings, [row["greatest error [mm]"] for row in here]),
        }


def plain_directions(fields: Fields, plan: TimedPlan) -> FloatArray:
    """Return unit directions (p, 2) from np.gradient of the travel times, continued into walls by the nearest value."""
    level = plan.level
    packed = fields.packed
    nx, ny = packed.shape[level]
    first = int(packed.offset[packed.field_of[level, 0]])
    values = packed.travel_time[first : first + nx * ny].reshape(nx, ny).copy()
    walls = ~np.isfinite(values)
    nearest = ndimage.distance_transform_edt(walls, return_distances=False, return_indices=True)
    gradient = np.gradient(values[tuple(nearest)], packed.spacing)
    place = ((plan.points - packed.origin[level]) / packed.spacing).T
    directions = -np.stack([ndimage.map_coordinates(part, place, order=1) for part in gradient], axis=1)
    return np.asarray(directions / np.maximum(np.hypot(*directions.T), 1e-300)[:, None])


def angles_between(first: FloatArray, other: FloatArray) -> FloatArray:
    """Return the angles (p,) between unit vectors [degrees]; 180 where one of them is zero."""
    cross = first[:, 0] * other[:, 1] - first[:, 1] * other[:, 0]
    along = np.sum(first * other, axis=1)
    is_missing = ~(first.any(axis=1) & other.any(axis=1))
    return np.where(is_missing, 180.0, np.degrees(np.abs(np.arctan2(cross, along))))


def _angle_rows(plan: TimedPlan, spacings: Sequence[float], clean: CleanWays) -> Iterator[Row]:
    for spacing in spacings:
        fields = _fields(plan, spacing, 2)
        kept = _fields(plan, spacing, 2, CLEARANCE).directions_at(plan.level, plan.points, 0)
        away = plan.time > CLEAR_EXIT
        # Two ways whose meeting is some cells away differ by up to twice as many in length.
        single = away & (clean.to_meeting > 0.5 * CLEAR_CELLS * spacing)
        compared = away & (plan.lead > CLEAR_CELLS * spacing)
        ours = fields.directions_at(plan.level, plan.points, 0)
        angles = {
            "ours": (angles_between(ours, plan.direction), compared),
            "np.gradient": (angles_between(plain_directions(fields, plan), plan.direction), compared),
            "with clearance": (angles_between(kept, clean.direction), single),
        }
        bent = angles_between(kept, plan.direction)
        for where, (low, high) in RANGES.items():
            near = (plan.wall_distance >= low) & (plan.wall_distance < high)
            if not all((near & chosen).any() for _, chosen in angles.values()):
                continue
            row: dict[str, Any] = {"plan": plan.name, "spacing [m]": spacing, "where": where}
            row["places"] = int((near & compared).sum())
            row |= {f"{name}, mean": float(angle[near & chosen].mean()) for name, (angle, chosen) in angles.items()}
            row |= {f"{name}, greatest": float(angle[near & chosen].max()) for name, (angle, chosen) in angles.items()}
            yield {**row, "clearance from geodesics, mean": float(bent[near & compared].mean())}


def draw(rows: Sequence[Row]) -> Any:
    """Draw errors over build time, a panel per plan."""
    plans = list(dict.fromkeys(row["plan"] for row in rows))
    figure, axes = new_figure(11.0, 3.6, 1, len(plans), sharey=True)
    for axis, plan in zip(axes, plans, strict=True):
        for order in ORDERS:
            line = [row for row in rows if row["plan"] == plan and row["order"] == order]
            times = [row["time [ms]"] for row in line]
            for key, style in (("mean error [mm]", "o-"), ("greatest error [mm]", "s--")):
                label = f"order {order}, {key[:-11]}"
                axis.loglog(times, [r[key] for r in line], style, color=f"C{order}", label=label)
        for row in line:
            axis.annotate(
                f"{row['spacing [m]']:g}", (row["time [ms]"], row["mean error [mm]"]), fontsize=7,
                textcoords="offset points", xytext=(0, -11), ha="center",
            )  # fmt: skip
        axis.margins(x=0.12, y=0.12)
        axis.set_title(plan, fontsize=9)
        axis.xaxis.set_minor_formatter("")
        axis.set_xlabel("time of a build [ms]")
    axes[0].set_ylabel("error [mm]")
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=4, fontsize=8)
    return figure


def draw_angles(rows: Sequence[Row]) -> Any:
    """Draw angle errors over spacing, a panel per plan and place."""
    plans = list(dict.fromkeys(row["plan"] for row in rows))
    figure, axes = new_figure(11.5, 8.0, len(RANGES), len(plans), sharex=True, sharey=True)
    for r, where in enumerate(RANGES):
        for axis, plan in zip(axes[r], plans, strict=True):
            line = [row for row in rows if row["plan"] == plan and row["where"] == where]
            for k, (name, marker) in enumerate((("ours", "o"), ("np.gradient", "s"), ("with clearance", "^"))):
                for what, style in (("mean", "-"), ("greatest", "--")):
                    axis.loglog(
                        [row["spacing [m]"] for row in line], [row[f"{name}, {what}"] for row in line], style,
                        color=f"C{k}", marker=marker, markersize=8.0 - 1.5 * k, markerfacecolor="none",
                        label=f"{name}, {what}",
                    )  # fmt: skip
            axis.set_title(f"{plan}, {where}", fontsize=9)
    for axis in axes[-1]:
        axis.set_xticks(SPACINGS, [f"{spacing:g}" for spacing in SPACINGS])
        axis.xaxis.set_minor_formatter("")
        axis.set_xlabel("spacing [m]")
    for axis in axes[:, 0]:
        axis.set_ylabel("angle error [degrees]")
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=3, fontsize=8)
    return figure
