"""Flows of a run beside the hydraulic calculation, and its evacuation time as a second opinion."""

from evac.analysis.hydraulic import LABORATORY, DesignFlow, design_flows, hydraulic_time
from evac.report.templates import APPENDIX, Cell, Section, fixed, section
from evac.results.results import Results

#: Greatest number of rows; those with the longest hydraulic times.
MOST_ROWS = 25


def design_section(run: Results) -> Section:
    """Return the section on design flows."""
    if run.building_or_none is None:
        return section("design", f"{APPENDIX}hydraulic calculation", "design_missing.html", is_missing=True)
    found = design_flows(run.building, run.flows, run.crowd.exit_time)
    decisive = hydraulic_time(found)
    shown = sorted(found, key=lambda one: -one.hydraulic_time)[:MOST_ROWS]
    rows, answer = [_row(one) for one in shown], _answer(run, decisive)
    return section("design", f"{APPENDIX}hydraulic calculation", rows=rows, answer=answer, laboratory=LABORATORY)


def _answer(run: Results, decisive: DesignFlow | None) -> str:
    if decisive is None:
        return "Nobody passed an exit, a door or a stair."
    own = "not everybody left" if run.last_out is None or not run.is_complete else f"{run.last_out:.1f} s"
    return (
        f"The hydraulic evacuation time of the building is {decisive.hydraulic_time:.1f} s, determined by "
        f"{decisive.kind} {decisive.name!r}; that of the run is {own}."
    )


def _row(one: DesignFlow) -> tuple[object, ...]:
    ratio = None if one.flow is None or not one.hydraulic_flow else one.flow / one.hydraulic_flow
    people = Cell(str(one.people), "bad") if one.people > one.capacity else str(one.people)
    flows = [fixed(number, 2) for number in (one.flow, one.hydraulic_flow, ratio, one.laboratory_flow)]
    last = str(one.capacity), fixed(one.hydraulic_time, 1)
    return one.kind, one.name, fixed(one.width, 2), people, *flows, *last
