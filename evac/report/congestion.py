"""Bottlenecks, congestion and maps of a run."""

from collections.abc import Sequence
from dataclasses import dataclass

from evac.analysis.congestion import DENSITY, SHARE, Exceedance
from evac.analysis.maps import KERNEL_RADIUS, level_maps
from evac.report import figures
from evac.report.templates import APPENDIX, Section, fixed, section
from evac.results.results import Results

#: Greatest number of places in the table, those congested longest.
MOST_PLACES = 10

#: Greatest number of queues with a map and a curve, those in which people waited longest in total.
MOST_QUEUES = 4

TITLE = "Bottlenecks and congestion"

#: The maps that a report has unless others are asked for.
MAPS = ("max_density", "waiting", "speed", "flow", "time_to_clear", "usage")


@dataclass(frozen=True)
class Places:
    """What is shown of the places of a run."""

    density: float = DENSITY  # above which a place is congested [1/m2], see `evac.analysis.congestion.find_congestion`
    least_time: float | None = None  # for how long it has to be exceeded [s]; None: a tenth of the evacuation time
    maps: Sequence[str] = MAPS  # names of `evac.analysis.maps.QUANTITIES`, in order
    service: str = ""  # levels of service as colours of densities, see `evac.pictures.scales.SERVICES`


USUAL = Places()


def congestion_sections(run: Results, places: Places) -> tuple[Section, ...]:
    """Return the sections on bottlenecks and on maps."""
    trajectory = run.trajectory
    if trajectory is None or not len(trajectory):
        return (section("congestion", TITLE, found=None, is_missing=True),)
    least_time = places.least_time
    if least_time is None:
        least_time = SHARE * (run.last_out if run.is_complete and run.last_out else run.time)
    watched = Exceedance(trajectory, places.density)
    maps = level_maps(trajectory, watch=watched.add)
    found = watched.congestion(least_time)
    queues = run.queues
    pictures = figures.map_pictures(trajectory, places.maps, maps, run.flows, places.service)
    return (
        section(
            "congestion",
            TITLE,
            found=found,
            others=len(found.places) - MOST_PLACES,
            radius=KERNEL_RADIUS,
            trajectory=trajectory,
            queues=[
                figures.bottleneck(trajectory, queue, maps, number)
                for number, queue in enumerate(queues[:MOST_QUEUES], 1)
            ],
            other_queues=len(queues) - MOST_QUEUES,
            places=[
                (
                    str(number),
                    place.level,
                    place.near,
                    f"({place.x:.1f},\u00a0{place.y:.1f})",
                    fixed(place.area, 1),
                    fixed(place.density, 1),
                    f"{place.start:.1f}\u00a0to\u00a0{place.end:.1f}",
                    fixed(place.duration, 1),
                    fixed(place.longest_spell, 1),
                )
                for number, place in enumerate(found.places[:MOST_PLACES], 1)
            ],
        ),
        *([section("maps", f"{APPENDIX}maps", pictures=pictures)] if pictures else []),
    )
