"""Maps of verdicts on each contact model over two parameters, cell by cell, with curves of the theory."""

from collections.abc import Callable, Mapping, Sequence
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from scipy.interpolate import make_interp_spline

from evac.base.arrays import FloatArray
from evac.evidence.evidence import Evidence, Row, new_figure
from evac.evidence.stability.trials import BEYOND, DEGRADED, HANDLED, REFUSED, RIGHT, VERDICTS, WRONG, Verdict

#: Colours of the verdicts (Okabe-Ito, with grey and black).
COLOURS = {
    RIGHT: "#009E73",
    HANDLED: "#56B4E9",
    DEGRADED: "#E69F00",
    BEYOND: "#CC3311",
    REFUSED: "0.75",
    WRONG: "#000000",
}

#: What marks refused cells in which a body would have been pressed through a wall.
WALL_MARK: Mapping[str, Any] = {"marker": "|", "color": "0.35", "markersize": 6}

#: Line styles of the curves, in the order in which their labels come up.
STYLES = ("-", "--", ":", "-.")

#: Points between two given ones of a curve: it bends between cells, whose values are not evenly spaced.
BETWEEN = 60


class Cell(NamedTuple):
    """One trial of a map."""

    panel: str
    x: float
    y: float
    verdict: Verdict


class Curve(NamedTuple):
    """A labelled curve of the theory: points (x, y), connected by straight lines in logarithms.

    The same label has the same style in all panels.
    """

    label: str
    x: Sequence[float]
    y: Sequence[float]


#: What a map is made of: its cells, and by panel the curves of the theory.
Mapped = tuple[Sequence[Cell], Mapping[str, Sequence[Curve]]]


def show_map(
    evidence: Evidence, name: str, compute: Callable[[Evidence], Mapped], axes: tuple[str, str], columns: int = 3
) -> list[str]:
    """Write NAME.csv with every cell, draw NAME.png, put the plot and the sums by panel on the page; return the kinds.

    Each panel's cells form a full grid over `axes`, what x and y are, with units; `columns` panels are beside each
    other.
    """

    @cache
    def mapped() -> Mapped:
        return compute(evidence)

    rows = evidence.measured(name, lambda: cell_rows(mapped()[0], axes))
    panels = dict.fromkeys(row["panel"] for row in rows)
    sums = [_sums(panel, [row for row in rows if row["panel"] == panel]) for panel in panels]
    evidence.show("show_map", __name__, name=name, sums=sums, draw=lambda: _draw(*mapped(), axes, columns))
    return [row["verdict"] for row in rows]


def cell_rows(cells: Sequence[Cell], axes: tuple[str, str]) -> list[Row]:
    """Return a row for each cell, with its verdict, error and words."""
    columns = ("panel", *axes, "verdict", "error", "words")
    return [dict(zip(columns, (cell.panel, cell.x, cell.y, *cell.verdict), strict=True)) for cell in cells]


def _sums(panel: str, rows: Sequence[Row]) -> dict[str, str | int | float]:
    errors = [row["error"] for row in rows if np.isfinite(row["error"])]
    counts = {kind: sum(row["verdict"] == kind for row in rows) for kind in VERDICTS}
    return {"panel": panel, **counts, "greatest error": max(errors, default=float("nan"))}


def _draw(cells: Sequence[Cell], curves: Mapping[str, Sequence[Curve]], axes: tuple[str, str], columns: int) -> Any:
    panels = list(dict.fromkeys(cell.panel for cell in cells))
    columns = min(columns, len(panels))
    rows = -(-len(panels) // columns)
    figure, drawn = new_figure(1.0 + 3.4 * columns, 0.9 + 3.1 * rows, rows, columns, squeeze=False)
    labels = dict.fromkeys(curve.label for panel in curves.values() for curve in panel)
    styles = dict(zip(labels, STYLES, strict=False))
    for axis, panel in zip(drawn.ravel(), panels, strict=False):
        _draw_panel(axis, [cell for cell in cells if cell.panel == panel], curves.get(panel, ()), styles)
        axis.set_title(panel, fontsize=9)
    for axis in drawn.ravel()[len(panels) :]:
        axis.set_visible(False)
    for axis in drawn[-1]:
        axis.set_xlabel(axes[0])
    for axis in drawn[:, 0]:
        axis.set_ylabel(axes[1])
    _draw_legend(figure, cells, styles)
    return figure


def _draw_panel(axis: Any, cells: Sequence[Cell], curves: Sequence[Curve], styles: Mapping[str, str]) -> None:
    """Draw one panel: squares at equal distances whatever the values, with the theory laid over them."""
    from matplotlib.colors import ListedColormap
    from matplotlib.patheffects import withStroke

    x_values = sorted({cell.x for cell in cells})
    y_values = sorted({cell.y for cell in cells})
    kinds = np.full((len(y_values), len(x_values)), np.nan)
    for cell in cells:
        column, row = x_values.index(cell.x), y_values.index(cell.y)
        kinds[row, column] = VERDICTS.index(cell.verdict.kind)
        if cell.verdict.kind == WRONG:
            axis.plot(column + 0.5, row + 0.5, "X", color="w", markersize=4)
        elif _met_a_wall(cell):
            axis.plot(column + 0.5, row + 0.5, **WALL_MARK)
    colours = ListedColormap([COLOURS[kind] for kind in VERDICTS])
    axis.pcolormesh(kinds, cmap=colours, vmin=-0.5, vmax=len(VERDICTS) - 0.5, edgecolors="w", linewidth=0.5, zorder=0)
    for curve in curves:
        x, y = _places(x_values, _dense(curve.x)), _places(y_values, _dense(curve.y))
        (line,) = axis.plot(x + 0.5, y + 0.5, color="k", linestyle=styles[curve.label], linewidth=1.6)
        line.set_path_effects([withStroke(linewidth=3.2, foreground="w")])
    axis.set(xlim=(0, len(x_values)), ylim=(0, len(y_values)))
    axis.set_xticks(*_ticks(x_values), rotation=45, fontsize=7)
    axis.set_yticks(*_ticks(y_values), fontsize=7)
    axis.grid(False)


def _met_a_wall(cell: Cell) -> bool:
    return cell.verdict.kind == REFUSED and "wall" in cell.verdict.words


def _dense(values: Sequence[float]) -> FloatArray:
    given = np.arange(len(values))
    wanted = np.linspace(0.0, given[-1], BETWEEN * (len(values) - 1) + 1)
    return np.asarray(np.exp(np.interp(wanted, given, np.log(np.asarray(values, dtype=float)))))


def _ticks(values: Sequence[float]) -> tuple[list[float], list[str]]:
    """Return places and labels: all values where there are few, else the powers of ten among them."""
    few = len(values) <= 10
    chosen = [k for k, value in enumerate(values) if few or np.isclose(np.log10(value) % 1.0, (0.0, 1.0)).any()]
    return [k + 0.5 for k in chosen], [f"{values[k]:.3g}" for k in chosen]


def _places(values: Sequence[float], wanted: FloatArray) -> FloatArray:
    """Return where numbers lie among the cells' values, logarithmically; nowhere if there are fewer than two."""
    usable = [k for k, value in enumerate(values) if 0.0 < value < np.inf]
    if len(usable) < 2:
        return np.full(len(wanted), np.nan)
    spline = make_interp_spline(np.log([values[k] for k in usable]), np.array(usable, dtype=float), k=1)
    return np.asarray(spline(np.log(wanted)))  # which goes on straight beyond the ends


def _draw_legend(figure: Any, cells: Sequence[Cell], styles: Mapping[str, str]) -> None:
    from matplotlib.lines import Line2D

    present = {cell.verdict.kind for cell in cells}
    handles = [
        Line2D([], [], linestyle="", marker="s", markersize=9, color=COLOURS[kind], label=kind)
        for kind in VERDICTS
        if kind in present
    ]
    if any(_met_a_wall(cell) for cell in cells):
        handles.append(Line2D([], [], linestyle="", label="refused at a wall", **WALL_MARK))
    handles += [Line2D([], [], color="k", linestyle=style, label=label) for label, style in styles.items()]
    figure.legend(handles=handles, loc="outside lower center", ncols=4, fontsize=8, frameon=False)
