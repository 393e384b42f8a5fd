"""Congestion and maps of a run."""

from collections.abc import Sequence

from evac.analysis.congestion import SHARE, Congestion, find_congestion
from evac.analysis.maps import KERNEL_RADIUS, QUANTITIES, level_maps
from evac.report import figures
from evac.report.html import Html, Section, fixed, paragraph, table
from evac.results.results import Results

#: The maps that a report has unless others are asked for.
MAPS = ("max_density", "waiting", "speed", "flow", "time_to_clear", "usage")


def congestion_sections(
    run: Results, density: float, least_time: float | None, maps: Sequence[str] = MAPS
) -> tuple[Section, ...]:
    """Return the sections on congestion and on maps.

    Parameters
    ----------
    run : Results
    density : float [1/m2]
        Threshold.
    least_time : float or None [s]
        For how long it has to be exceeded; by default a share of the evacuation time.
    maps : sequence of str
        Names of `evac.analysis.maps.QUANTITIES`, in order.
    """
    if run.trajectory is None or not len(run.trajectory):
        missing = paragraph(
            "No motion was recorded. Congestion cannot be evaluated and must be assessed by the author."
        )
        return (Section("congestion", "Congestion", (missing,), is_missing=True),)
    if least_time is None:
        least_time = SHARE * (run.last_out if run.is_complete and run.last_out else run.time)
    found = find_congestion(run.trajectory, density, least_time)
    computed = level_maps(run.trajectory)
    places = figures.map_picture(
        run.trajectory,
        "max_density",
        computed,
        "Maximum density at any recorded time"
        + (", with the numbers of the congested places of the table." if found.places else "."),
        found.places,
    )
    pictures = [
        figures.map_picture(run.trajectory, name, computed, f"{QUANTITIES[name].label}: {QUANTITIES[name].doc}.")
        for name in maps
        if name != "max_density"
    ]
    sections = [Section("congestion", "Congestion", (*_told(run, found), places))]
    if pictures:
        words = paragraph(
            "Time averages use the trapezoidal rule over the recorded times. People slower than 0.2 m/s count as"
            " waiting, also those who have not started yet."
        )
        sections.append(Section("maps", "Maps", (words, *pictures)))
    return tuple(sections)


def _told(run: Results, found: Congestion) -> list[Html]:
    assert run.trajectory is not None
    parts = [
        paragraph(
            f"A place is congested if the density exceeds {found.density:g} people per m² for longer than"
            f" {found.least_time:.1f} s in total. The density of a person is a Gaussian kernel of radius"
            f" {KERNEL_RADIUS:g} m, normalised by its part on the floor; a single person causes about 0.65 people per"
            f" m² at the centre. {len(run.trajectory)} recorded times from {run.trajectory.time[0]:g} to"
            f" {run.trajectory.time[-1]:g} s were evaluated."
        ),
        paragraph(
            "Threshold and duration are options of the report. The defaults are those of IMO MSC.1/Circ.1533 for"
            " advanced analyses: 4 people per m² for more than 10 % of the evacuation time.",
            class_="small",
        ),
        paragraph(
            f"The maximum density was {found.greatest_density:.2f} people per m². The longest time for which"
            f" {found.density:g} people per m² were exceeded at one place was {found.longest:.1f} s."
        ),
    ]
    if not found.places:
        return [*parts, paragraph("There was no significant congestion by this criterion.")]
    rows = [
        (
            str(number),
            place.level,
            place.near,
            f"({place.x:.1f}, {place.y:.1f})",
            fixed(place.area, 1),
            fixed(place.density, 1),
            f"{place.start:.1f} to {place.end:.1f}",
            fixed(place.duration, 1),
            fixed(place.longest_spell, 1),
        )
        for number, place in enumerate(found.places, 1)
    ]
    columns = (
        "no.",
        "level",
        "nearest portal or exit",
        "x, y [m]",
        "area [m²]",
        "maximum density [1/m²]",
        "from, to [s]",
        "total time [s]",
        "longest period [s]",
    )
    return [*parts, table("Significant congestion: places and durations", columns, rows)]
