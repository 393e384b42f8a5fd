"""Display of results and buildings in notebooks: tables, egress curve, replay, plans."""

import base64
import io
from collections.abc import Iterable, Sequence
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

from evac.building.model.building import Building
from evac.folder.files import REPLAY_NAME
from evac.pictures.palette import VERDICTS
from evac.results.tables import TABLES

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from evac.results.results import Results
    from evac.results.verdict import Verdict

#: Greatest size of a replay that is embedded in a notebook; of larger ones the path is shown [bytes].
LARGEST_REPLAY = 5_000_000


def results_html(results: "Results") -> str:
    """Return the results of a run as HTML."""
    answer = results.answer
    answers = [line for line in (answer.outcome, answer.times, answer.queue, answer.movement) if line]
    lines = (*results.warnings, *answer.remarks, *results.quality_warnings)
    parts = [
        verdict_html(results.verdict),
        f"<h4>{escape(results.title or Path(results.source).name)}</h4>",
        "<p>" + "<br>".join(map(escape, answers)) + "</p>",
        table_html(TABLES["exits"].head, results.tables["exits"]),
        "".join(f"<p>&#9888; {escape(line)}</p>" for line in lines),
        figure_html(results.plot(), "egress curve"),
        _replay_html(results),
    ]
    return "".join(parts)


def verdict_html(verdict: "Verdict") -> str:
    """Return a verdict as a paragraph of HTML."""
    style = f"border-left: 4px solid {VERDICTS[verdict['status']]}; padding-left: 8px"
    return f'<p style="{style}"><b>{escape(verdict["text"])}</b></p>'


def building_figure(building: Building) -> "Figure":
    """Return a figure with the plan of every storey of a building and its warnings."""
    from evac.pictures.annotated import levels_figure

    return levels_figure(building, building.findings, title=building.source.name)


def table_html(head: Sequence[str], rows: Iterable[Sequence[Any]]) -> str:
    """Return an HTML table with numbers rounded to four digits."""
    names = "".join(f"<th>{escape(name)}</th>" for name in head)
    body = "".join(f"<tr>{''.join(f'<td>{_cell(value)}</td>' for value in row)}</tr>" for row in rows)
    return f"<table><tr>{names}</tr>{body}</table>"


def figure_html(figure: "Figure", alt: str) -> str:
    """Return a figure as an HTML image with an alternative text."""
    from evac.pictures.writing import legible_figure, listed

    with io.BytesIO() as file, legible_figure(figure) as names:
        figure.savefig(file, format="png", dpi=90)
        image = base64.b64encode(file.getvalue()).decode()
    return f'<img alt="{escape(alt)}" src="data:image/png;base64,{image}">{escape(", ".join(listed(names)))}'


def _cell(value: Any) -> str:
    if value is None:
        return ""
    return escape(f"{value:.4g}" if isinstance(value, float) else str(value))


def _replay_html(results: "Results") -> str:
    """Return the replay in the result folder as an HTML frame; empty if there is none."""
    path = results.folder / REPLAY_NAME if results.folder is not None else None
    if path is None or not path.is_file():
        return ""
    if path.stat().st_size > LARGEST_REPLAY:
        return f"<p>The replay is in {escape(str(path))}.</p>"
    page = escape(path.read_text(encoding="utf-8"), quote=True)
    return f'<iframe title="replay" style="width: 100%; height: 600px; border: 0" srcdoc="{page}"></iframe>'
