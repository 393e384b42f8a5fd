"""Accuracy, part b: orders of convergence from errors over the step, comparison of the drives, charts."""

import math
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from evac.case.schema import SimulationSettings
from evac.evidence.evidence import MODEL_COLOURS, Row, new_figure

DRIVES = ("exponential", "explicit")

#: Marker, marker size and line width of each line, such that lines on top of each other remain visible.
STYLES = (("o", 9.0, 4.0), ("s", 6.5, 2.6), ("^", 5.5, 1.8), ("D", 4.0, 1.3), (".", 4.0, 0.8))

#: Errors below this are due to solver and rounding, not to the step [m].
EXACT = 1e-8

#: Orders that differ by no more than this count as equal.
CLOSE = 0.3


def order_of(steps: Sequence[float], errors: Sequence[float]) -> float:
    """Return the measured order of convergence: the slope of log error over log step, least squares."""
    return float(np.polyfit(np.log(steps), np.log(errors), 1)[0])


def colour_of(variant: str) -> str:
    """Return the colour of the contact model that a label such as ``"NSM2, K_N = 0"`` begins with."""
    return next(colour for model, colour in MODEL_COLOURS.items() if variant.startswith(model))


def order_rows(rows: Sequence[Row]) -> Iterator[Row]:
    """Return measured and theoretical orders of every problem, model and drive."""
    for name, model, drive in dict.fromkeys((row["problem"], row["model"], row["drive"]) for row in rows):
        here = [row for row in rows if (row["problem"], row["model"], row["drive"]) == (name, model, drive)]
        small = [row for row in here if row["error [m]"] > EXACT][-5:]
        at = [row["error [m]"] for row in here if math.isclose(row["h [s]"], 0.01)]
        yield {
            "problem": name,
            "model": model,
            "drive": drive,
            "theory": here[0]["theory"],
            "measured order": _slope(small) if len(small) > 2 else None,
            "over the last halving": _slope(small[-2:]) if len(small) > 2 else None,
            "error at h = 0.01 s [mm]": 1e3 * at[0] if at else None,
            "greatest error / (v h), h <= 0.01 s": max(r["error / (v h)"] for r in here if r["h [s]"] < 0.0101),
        }


def _slope(rows: Sequence[Row]) -> float:
    return order_of([row["h [s]"] for row in rows], [row["error [m]"] for row in rows])


def orders_off(table: Sequence[Row]) -> list[Row]:
    """Return the rows whose measured orders are not the theoretical ones."""
    known = [row for row in table if row["measured order"] is not None]
    return [row for row in known if abs(row["measured order"] - row["theory"]) > CLOSE]


def drives_compared(rows: Sequence[Row]) -> tuple[int, int]:
    """Return the number of problems and models with a smaller error of the exponential drive at the default step.

    The second number counts all whose error depends on the drive.
    """
    step = min({row["h [s]"] for row in rows}, key=lambda h: abs(h - SimulationSettings().step))
    errors: dict[tuple[str, str], dict[str, float]] = {}
    for row in rows:
        if row["h [s]"] == step:
            errors.setdefault((row["problem"], row["model"]), {})[row["drive"]] = row["error [m]"]
    pairs = [pair for pair in errors.values() if differ(pair)]
    return sum(pair["explicit"] > pair["exponential"] for pair in pairs), len(pairs)


def differ(pair: dict[str, float]) -> bool:
    """Return whether both drives were run, and their errors differ by more than rounding."""
    return len(pair) == 2 and abs(pair["explicit"] - pair["exponential"]) > 1e-3 * max(pair.values()) + 1e-9


def draw(rows: Sequence[Row], across: str) -> Any:
    """Draw the errors of every problem over a column of the rows; those of rounding are named, not drawn."""
    names = list(dict.fromkeys(row["problem"] for row in rows))
    models = list(dict.fromkeys(row["model"] for row in rows))
    figure, axes = new_figure(11.0, 7.5, 2, 3, sharex=True, sharey=True)
    handles = {}
    for axis, name in zip(np.ravel(axes), names, strict=False):
        exact = []
        for model, (marker, size, width) in zip(models, STYLES, strict=False):
            here = [row for row in rows if (row["problem"], row["model"]) == (name, model)]
            if max(row["error [m]"] for row in here) <= EXACT:
                exact.append(model)
            for drive, style in zip(DRIVES, ("-", "--"), strict=True):
                line = [row for row in here if row["drive"] == drive and row["error [m]"] > EXACT]
                (drawn,) = axis.loglog(
                    [row[across] for row in line], [row["error [m]"] for row in line], style,
                    color=colour_of(model), marker=marker, markersize=size, markerfacecolor="none", linewidth=width,
                )  # fmt: skip
                handles[f"{model}, {drive}"] = drawn
        handles["rounding"] = axis.axhline(EXACT, color="0.6", linewidth=1.0, linestyle=":")
        if exact:
            axis.annotate("exact: " + ", ".join(exact), (0.02, 0.02), xycoords="axes fraction", fontsize=7, va="bottom")
        axis.set_title(name, fontsize=9)
    axes[0, 0].set_ylim(bottom=0.1 * EXACT)
    for axis in axes[-1]:
        axis.set_xlabel("h [s]" if across == "h [s]" else "CPU time [s]")
    for axis in axes[:, 0]:
        axis.set_ylabel("error of positions [m]")
    figure.legend(handles.values(), handles.keys(), loc="outside lower center", ncols=4, fontsize=8)
    return figure
