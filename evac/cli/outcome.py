"""What is shown after a run: the answer, and on request all tables."""

from operator import itemgetter
from pathlib import Path
from typing import Any

import numpy as np

from evac.base.errors import in_order
from evac.cli.screen import height, say, show_facts, show_table
from evac.folder.files import ANIMATION_NAME, REPLAY_NAME
from evac.physics.state import Crowd
from evac.results.results import Results

#: Maximum number of lines that the answer takes on a terminal, with the line of the result folder.
MOST_LINES = 12

#: Maximum number of listed people without progress; summary.json has all of them.
MOST_LISTED = 20

#: Why steps are cut, by the names of the counts.
CUTS = {
    "too_stiff_steps": "stiff contacts",
    "too_fast_steps": "fast people",
    "wall_crossings_prevented": "walls",
    "passes_prevented": "people passing each other",
}


def show_answer(results: Results, below: int = 1) -> None:
    """Show what the run answers; on a terminal in `MOST_LINES` with as many as are shown `below`.

    What is cut first, to a line and then to nothing, are the title and how people move, then exits, changes and
    remarks, and the queue; the verdict and the times never are.
    """
    answer, title = results.answer, results.title or Path(results.source).name
    changes = f"Changes: {', '.join(map(str, results.changes))}" if results.changes else ""
    notes = [changes, *answer.remarks, answer.queue]
    lines = [title, answer.verdict, answer.times, *answer.exits, *notes, answer.movement]
    lines.append(f"{answer.warnings}; --verbose shows all" if answer.warnings else "")
    heights = [height(line) for line in lines]
    heights[0] = 1
    first = 3 + len(answer.exits)
    of_notes = range(first, first + len(notes))
    for least, rows in ((1, (len(lines) - 2, *range(first - 1, 2, -1), *of_notes, len(lines) - 1)), (0, of_notes)):
        for row in rows:
            heights[row] -= max(0, min(heights[row] - least, sum(heights) + below - MOST_LINES))
    for row, (line, most) in enumerate(zip(lines, heights, strict=True)):
        if most:
            say(line, most, is_bold=row < 2)


def show_results(results: Results) -> None:
    """Show all tables: egress, exits, stairs and people left inside, then contact and wall time by phase."""
    summary = results.summary()
    _show_outcome(summary, results)
    _show_places(summary, results)
    stuck = summary["stuck"]
    rows = [(own["person"], own["level"], round(own["x"], 2), round(own["y"], 2)) for own in stuck[:MOST_LISTED]]
    more = "" if len(stuck) <= MOST_LISTED else f", the first {MOST_LISTED} of {len(stuck)} (all in summary.json)"
    show_table(f"Without progress at the end{more}", ("person", "level", "x [m]", "y [m]"), rows)
    _show_contact(summary["contact"])
    wall = summary["wall_time"]
    phases = [*wall.items(), ("all", sum(wall.values()))]
    show_table("Wall time", ("phase", "s"), [(name, round(seconds, 3)) for name, seconds in phases])


def folder_line(folder: Path) -> str:
    """Return the line that names the result folder and the files in it that are played, shown last."""
    shown = {REPLAY_NAME: "browser", ANIMATION_NAME: "ParaView"}
    files = [f", {name} ({where})" for name, where in shown.items() if (folder / name).is_file()]
    return f"results in  {folder}{''.join(files)}"


def response_times(crowd: Crowd) -> str:
    """Describe when people start to walk."""
    times = crowd.start_time
    times = times[np.isfinite(times)]  # of those who start
    if not times.any():
        return "none: everybody starts at 0 s"
    return f"{times.min():.4g} to {times.max():.4g} s"


def _show_outcome(summary: dict[str, Any], results: Results) -> None:
    last, left = summary["last_out"], len(results.leaving) - summary["evacuated"]
    note = f", the last of those who are out; people left: {left}" if left else ""
    changes = {"changes": ", ".join(map(str, results.changes))} if results.changes else {}
    show_facts(
        {
            "case": summary["title"],
            "ended": summary["ended"],
            "people": summary["people"],
            "out": summary["evacuated"],
            "movement": results.answer.movement,
            "response times": response_times(results.crowd),
            **changes,
            "last out": None if last is None else f"{last:.2f} s{note}",
            "simulated": f"{summary['simulated_time']:.2f} s in {summary['steps']} steps, seed {summary['seed']}",
        }
    )


def _show_places(summary: dict[str, Any], results: Results) -> None:
    columns: tuple[str, ...] = ("people", "last_out", "width", "flow", "flow_per_metre")
    labels = {way.name: results.building.label_of(way) for way in results.building.exits}
    exits = [(labels[name], *(use[column] for column in columns)) for name, use in summary["exits"].items()]
    exits = in_order(exits, itemgetter(0))
    show_table("Exits", ("exit", "people", "last out [s]", "width [m]", "flow [1/s]", "per metre [1/s/m]"), exits)
    columns = ("people", "greatest_number", "last_left")
    stairs = [(name, *(use[column] for column in columns)) for name, use in summary["stairs"].items()]
    show_table("Stairs", ("stair", "people", "maximum number", "last left [s]"), stairs)


def _show_contact(contact: dict[str, Any]) -> None:
    energy = contact["energy"]
    balance = energy["driving_work"] - energy["contact_dissipation"] + energy["contact_creation"]
    rows = [
        ("contact model", contact["model"]),
        ("maximum overlap", f"{1000.0 * contact['greatest_overlap']:.3g} mm"),
        ("mean overlap", f"{1000.0 * contact['mean_overlap']:.3g} mm"),
        ("maximum residual", f"{contact['greatest_residual']:.3g} m/s"),
        ("unconverged steps", f"{contact['unconverged_steps']:.0f} of {contact['steps']:.0f}"),
        ("work of driving", f"{energy['driving_work']:.4g} J"),
        ("dissipated in contacts", f"{energy['contact_dissipation']:.4g} J"),
        ("created in contacts", f"{energy['contact_creation']:.4g} J"),
        ("balance: carried out or still in motion", f"{balance:.4g} J"),
    ]
    if cut := ", ".join(f"{reason} {contact[name]}" for name, reason in CUTS.items() if contact[name]):
        rows.insert(5, ("steps cut into smaller ones", cut))
    show_table("Contact", ("quantity", "value"), rows)
