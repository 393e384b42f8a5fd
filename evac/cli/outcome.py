"""What is shown after a run: the answer, and on request all tables."""

import shutil
from pathlib import Path
from typing import Any

import numpy as np

from evac.cli.screen import say, show_facts, show_table
from evac.folder.files import ANIMATION_NAME, REPLAY_NAME
from evac.physics.state import Crowd
from evac.results.results import Results

#: Maximum number of lines that the answer takes on a terminal of this width, with the line of the result folder.
MOST_LINES, WIDTH = 12, 80

#: Maximum number of listed people without progress; summary.json has all of them.
MOST_LISTED = 20


def show_answer(results: Results) -> None:
    """Show what the run answers: on a terminal in at most a dozen lines with the folder, which is shown after it."""
    answer, title = results.answer, results.title or Path(results.source).name
    each = 1 if shutil.get_terminal_size().columns >= WIDTH else 2
    room = MOST_LINES - 4 - sum(map(bool, (answer.times, answer.warnings))) - len(answer.exits)  # for the others
    say(title, 1, is_bold=True)
    say(answer.verdict, each, is_bold=True)
    for line in filter(None, (answer.times, *answer.exits)):
        say(line, each)
    changes = f"Changes: {', '.join(map(str, results.changes))}" if results.changes else ""
    told = [line for line in (changes, *answer.remarks, answer.queue) if line]
    for number, line in enumerate(told):
        lines = min(2, room - (len(told) - number - 1))
        if lines > 0:
            room -= say(line, lines)
    say(answer.movement, each)
    if answer.warnings:
        say(f"{answer.warnings}; --verbose shows all", each)


def show_results(results: Results) -> None:
    """Show all tables: egress, exits, stairs and people left inside, then contact and wall time by phase."""
    summary = results.summary()
    _show_outcome(summary, results)
    _show_places(summary, results)
    _show_left(summary)
    _show_contact(summary["contact"])
    wall = summary["wall_time"]
    phases = [*wall.items(), ("all", sum(wall.values()))]
    show_table("Wall time", ("phase", "s"), [(name, round(seconds, 3)) for name, seconds in phases])


def show_folder(folder: Path) -> None:
    """Show the result folder and the files in it that are played, as the last line."""
    shown = {REPLAY_NAME: "browser", ANIMATION_NAME: "ParaView"}
    files = [f", {name} ({where})" for name, where in shown.items() if (folder / name).is_file()]
    show_facts({"results in": "".join([str(folder), *files])})


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
    columns = ("people", "last_out", "width", "flow", "flow_per_metre")
    labels = {way.name: results.building.label_of(way) for way in results.building.exits}
    exits = [(labels[name], *(use[column] for column in columns)) for name, use in summary["exits"].items()]
    show_table("Exits", ("exit", "people", "last out [s]", "width [m]", "flow [1/s]", "per metre [1/s/m]"), exits)
    if summary["stairs"]:
        stairs = [
            (name, use["people"], use["greatest_number"], use["last_left"]) for name, use in summary["stairs"].items()
        ]
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
    cut = contact["too_fast_steps"] + contact["too_stiff_steps"] + contact["wall_crossings_prevented"]
    if cut:
        value = f"{cut} times; maximum speed {contact['greatest_speed']:.3g} m/s"
        rows.insert(5, ("steps cut into smaller ones", value))
    if contact["hardened_contacts"]:
        rows.insert(3, ("hardened contacts", f"{contact['hardened_contacts']} of {contact['contacts']}"))
    show_table("Contact", ("quantity", "value"), rows)


def _show_left(summary: dict[str, Any]) -> None:
    """List people without progress."""
    stuck = summary["stuck"]
    if stuck:
        rows = [(p["person"], p["level"], round(p["x"], 2), round(p["y"], 2)) for p in stuck[:MOST_LISTED]]
        more = "" if len(stuck) <= MOST_LISTED else f", the first {MOST_LISTED} of {len(stuck)} (all in summary.json)"
        show_table(f"Without progress at the end{more}", ("person", "level", "x [m]", "y [m]"), rows)
