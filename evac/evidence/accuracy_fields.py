"""Accuracy, part d: travel times and directions against exact geodesics, over grid spacing and order."""

import time
from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy import ndimage

from evac.directions.build import build_fields
from evac.directions.fields import Fields
from evac.directions.routes import Route
from evac.evidence.accuracy_data import order_of
from evac.evidence.accuracy_plans import PLANS, Plan
from evac.evidence.reference import FloatArray
from evac.evidence.report import Evidence, new_figure

SPACINGS = (0.2, 0.1, 0.05, 0.025)
WHATS = ("mean", "greatest")
ORDERS = (1, 2)

#: Ranges of the distance to the nearest wall [m]: where no body's centre comes, beside walls, elsewhere.
RANGES = {"below 0.2 m of a wall": (0.0, 0.2), "0.2 to 0.4 m": (0.2, 0.4), "beyond 0.4 m": (0.4, np.inf)}

#: Directions are compared where no other way is shorter than this many cells more, and this far from the exit [m].
CLEAR_CELLS = 3.0
CLEAR_EXIT = 0.5

WALKED = Route(strategy="shortest")


def run(evidence: Evidence) -> None:
    """Compute part d and add it to the page."""
    points = 120 if evidence.quick else 600
    spacings = SPACINGS[:2] if evidence.quick else SPACINGS
    evidence.heading("d. Travel times and directions against exact geodesics")
    evidence.text(
        f"""Travel times at 1 m/s from {points} random places, half of them within 0.4 m of a wall, against exact ones:
        a visibility graph (L-corner, room with a pillar turned by 20 degrees, upper floor of the shipped school),
        or, over a flight of 32 degrees between two floors, the least time over the points where the seams are
        crossed. Times are without clearance from walls, as the travel times of a run always are. The time is that
        of all fields of the plan, grids and wall distances included."""
    )
    plans = [make(points, evidence.generator(make.__name__)) for make in PLANS]
    rows = [row for plan in plans for order in ORDERS for row in _time_rows(plan, spacings, order)]
    evidence.table("fields", rows, "Errors of travel times [mm at 1 m/s], and time of a build.")
    evidence.table("fields_order", _order_rows(rows), "Measured orders of the errors, over all spacings.")
    evidence.plot("fields", draw(rows), "Error of travel times over the time it takes to build them.")
    angles = [row for plan in plans if plan.direction is not None for row in _angle_rows(plan, spacings)]
    evidence.text(
        f"""Angles between the directions people get and the exact ones, by distance to the nearest wall; no body's
        centre comes nearer than its radius, some 0.2 m. "ours" is what `build_fields` gives without clearance:
        upwind differences of second order among nodes that the wave came from, and beside slanted walls a plane
        fitted to the lower nodes around; "np.gradient" the central
        differences of the same travel times, continued into the walls by the nearest value, as a plain
        implementation does. Places where another way is nearly as short, and those within {CLEAR_EXIT:g} m of the
        exit, are left out. With clearance, directions leave the geodesics on purpose, to keep bodies off walls: its
        columns say by how much at 0.25 m. No direction at all counts as 180 degrees."""
    )
    evidence.text(_angles_in_words(angles))
    evidence.table("angles", angles, "Angle errors [degrees]: mean and greatest.")
    evidence.plot("angles", draw_angles(angles), "Mean (full) and greatest (dashed) angle errors over the spacing.")


def _angles_in_words(rows: Sequence[dict[str, Any]]) -> str:
    """Return in how many rows the directions people get are nearer to the exact ones, in the mean and at worst."""
    nearer = {what: sum(row[f"ours, {what}"] <= row[f"np.gradient, {what}"] for row in rows) for what in WHATS}
    worst = max(rows, key=lambda row: row["ours, greatest"] - row["np.gradient, greatest"])
    told = ""
    if worst["ours, greatest"] > worst["np.gradient, greatest"]:
        told = (
            f" It loses most at {worst['plan']}, {worst['where']}, {worst['spacing [m]']:g} m: "
            f"{worst['ours, greatest']:.0f} degrees at worst, np.gradient {worst['np.gradient, greatest']:.0f}."
        )
    return (
        f'In {nearer["mean"]} of {len(rows)} rows "ours" is nearer to the exact directions in the mean, in '
        f"{nearer['greatest']} at the worst place.{told} By default people walk on the bent directions of the last "
        "columns."
    )


def _fields(plan: Plan, spacing: float, order: int, clearance: float = 0.0) -> Fields:
    return build_fields(
        plan.building, [WALKED], spacing=spacing, clearance=clearance, speeds=(1.0, 1.0, 1.0), order=order
    )


def _time_rows(plan: Plan, spacings: Sequence[float], order: int) -> list[dict[str, Any]]:
    """Return a row per spacing: errors of the travel times, and the time of a build (median of up to three)."""
    rows = []
    for spacing in spacings:
        fields = _fields(plan, spacing, order)
        spans: list[float] = []
        while len(spans) < 3 and sum(spans) < 1.0:
            start = time.perf_counter()
            _fields(plan, spacing, order)
            spans.append(time.perf_counter() - start)
        error = np.abs(fields.travel_time_at(plan.level, plan.points, 0) - plan.time)
        rows.append(
            {
                "plan": plan.name,
                "order": order,
                "spacing [m]": spacing,
                "mean error [mm]": 1e3 * float(error.mean()),
                "greatest error [mm]": 1e3 * float(error.max()),
                "greatest error [cells]": float(error.max()) / spacing,
                "nodes": len(fields.packed.travel_time),
                "time [ms]": 1e3 * float(np.median(spans)),
            }
        )
    return rows


def _order_rows(rows: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return measured orders of mean and greatest error by plan and order of the stencil."""
    table = []
    for plan, order in dict.fromkeys((row["plan"], row["order"]) for row in rows):
        here = [row for row in rows if row["plan"] == plan and row["order"] == order]
        spacings = [row["spacing [m]"] for row in here]
        table.append(
            {
                "plan": plan,
                "order of the stencil": order,
                "of the mean error": order_of(spacings, [row["mean error [mm]"] for row in here]),
                "of the greatest error": order_of(spacings, [row["greatest error [mm]"] for row in here]),
            }
        )
    return table


def plain_directions(fields: Fields, plan: Plan) -> FloatArray:
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
    found = -np.stack([ndimage.map_coordinates(part, place, order=1) for part in gradient], axis=1)
    return np.asarray(found / np.maximum(np.hypot(*found.T), 1e-300)[:, None])


def angles_between(one: FloatArray, other: FloatArray) -> FloatArray:
    """Return the angles (p,) between unit vectors [degrees]; 180 where one of them is zero."""
    cross = one[:, 0] * other[:, 1] - one[:, 1] * other[:, 0]
    along = np.sum(one * other, axis=1)
    is_missing = ~(one.any(axis=1) & other.any(axis=1))
    return np.where(is_missing, 180.0, np.degrees(np.abs(np.arctan2(cross, along))))


def _angle_rows(plan: Plan, spacings: Sequence[float]) -> list[dict[str, Any]]:
    """Return a row per spacing and place and range of the distance to walls."""
    assert plan.direction is not None
    rows = []
    for spacing in spacings:
        fields = _fields(plan, spacing, 2)
        kept = _fields(plan, spacing, 2, clearance=0.25)
        found = {
            "ours": angles_between(fields.directions_at(plan.level, plan.points, 0), plan.direction),
            "np.gradient": angles_between(plain_directions(fields, plan), plan.direction),
            "with clearance": angles_between(kept.directions_at(plan.level, plan.points, 0), plan.direction),
        }
        compared = (plan.lead > CLEAR_CELLS * spacing) & (plan.time > CLEAR_EXIT)
        for where, (low, high) in RANGES.items():
            chosen = compared & (plan.wall_distance >= low) & (plan.wall_distance < high)
            if not chosen.any():
                continue
            rows.append(
                {"plan": plan.name, "spacing [m]": spacing, "where": where, "places": int(chosen.sum())}
                | {f"{name}, mean": float(angle[chosen].mean()) for name, angle in found.items()}
                | {f"{name}, greatest": float(angle[chosen].max()) for name, angle in found.items()}
            )
    return rows


def draw(rows: Sequence[dict[str, Any]]) -> Any:
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
                    f"{row['spacing [m]']:g} m", (row["time [ms]"], row["mean error [mm]"]), fontsize=6,
                    textcoords="offset points", xytext=(3, -8),
                )  # fmt: skip
        axis.set_title(plan, fontsize=9)
        axis.xaxis.set_minor_formatter("")
        axis.set_xlabel("time of a build [ms]")
    axes[0].set_ylabel("error [mm]")
    axes[0].legend(fontsize=7)
    return figure


def draw_angles(rows: Sequence[dict[str, Any]]) -> Any:
    """Draw angle errors over spacing, a panel per plan and place."""
    plans = list(dict.fromkeys(row["plan"] for row in rows))
    figure, axes = new_figure(10.0, 8.0, len(RANGES), len(plans), sharex=True, sharey=True)
    for r, where in enumerate(RANGES):
        for axis, plan in zip(axes[r], plans, strict=True):
            line = [row for row in rows if row["plan"] == plan and row["where"] == where]
            for k, name in enumerate(("ours", "np.gradient")):
                for what, style in (("mean", "o-"), ("greatest", "s--")):
                    axis.loglog(
                        [row["spacing [m]"] for row in line],
                        [max(row[f"{name}, {what}"], 1e-3) for row in line],
                        style, color=f"C{k}", label=f"{name}, {what}",
                    )  # fmt: skip
            axis.set_title(f"{plan}, {where}", fontsize=9)
    for axis in axes[-1]:
        axis.set_xticks(SPACINGS, [f"{spacing:g}" for spacing in SPACINGS])
        axis.xaxis.set_minor_formatter("")
        axis.set_xlabel("spacing [m]")
    for axis in axes[:, 0]:
        axis.set_ylabel("angle error [degrees]")
    axes[0, 0].legend(fontsize=7)
    return figure
