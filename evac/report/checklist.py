"""What a documentation of an evacuation analysis should hold, point by point, and where the report has it."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass

from markupsafe import Markup

from evac.report.templates import APPENDIX, Cell, Section, section


@dataclass(frozen=True)
class Point:
    """A point of the documentation; of what the author has to add, it names what applies."""

    words: str
    sections: tuple[str, ...]  # that have it, where they are part of the report
    author: str = ""
    of_run: str = ""  # for the report of a single run
    content: str = ""  # that the sections need, see `Section.lacks`
    without: str = ""  # if a section lacks it


POINTS = (
    Point("Project, client, author and date", ("project",), "fill in the fields"),
    Point("Purpose of the analysis, protection goals and scenarios", ("purpose",), "write the purpose"),
    Point("Documents used: plans, their dates and versions", (), "name the plans on which the building is based"),
    Point("Building and geometry: storeys, areas, stairs", ("building",), "confirm that they agree with the plans"),
    Point(
        "Doors, exits and escape routes with clear widths",
        ("building",),
        content="doors",
        without="add the doors between rooms with their clear widths, which the building file does not name",
    ),
    Point("Exits, doors and stairs that are closed or not available", ("building",)),
    Point("Number of occupants and their initial distribution", ("occupants",), "justify the numbers"),
    Point(
        "Characteristics of occupants: composition, speeds, body sizes",
        ("occupants",),
        "justify the distributions; state ages and impairments, which the report does not contain",
    ),
    Point("Response (pre-movement) times", ("occupants",), "justify them: alarm, organisation, kind of use"),
    Point("Assumed routes and exits, and behaviour", ("occupants",), "justify them"),
    Point("Assumed fire, smoke and other hazards", ("fire",), "describe the scenario; evac computes no fire"),
    Point("Software, version and kind of model", ("model",)),
    Point("Parameters of the model, and changed parameters", ("model", "case")),
    Point("Verification and validation of the software", ("verification",), "assess the relevance of failed tests"),
    Point("Number of runs and seeds", ("model", "statistics"), of_run="one run does not show the variation of times"),
    Point(
        "Evacuation times: mean and percentiles over runs, or the times of people in one run",
        ("times", "statistics"),
        of_run="make a study of many runs",
    ),
    Point("Egress curves", ("times", "statistics")),
    Point("Evacuation times of exits", ("times", "exits")),
    Point("Evacuation times of storeys and stairs", ("times", "places")),
    Point("Congestion: places, densities and durations", ("congestion", "maps")),
    Point("Pictures of the course of the evacuation", ("maps",), "add pictures at selected times (evac render)"),
    Point("Warnings and special events of the runs", ("warnings",)),
    Point("Variants and sensitivity of the results", ("points",), "compare variants"),
    Point("Assessment: comparison with the protection goals, safety margins", ("assessment",), "write the assessment"),
    Point("Limits of the model and of the analysis", ("limits",)),
    Point("Data and files required to repeat the analysis", ("model", "case", "files"), "archive the building file"),
    Point("Signature", ("project",), "sign"),
)


def checklist_section(numbers: dict[str, str], lacking: Collection[str] = ()) -> Section:
    """Return the checklist.

    Parameters
    ----------
    numbers : dict of str to str
        Number of each section of the report that is not missing, by its id.
    lacking : collection of str
        Contents that sections lack.
    """
    rows = [(str(number), point.words, *_where(point, numbers, lacking)) for number, point in enumerate(POINTS, 1)]
    return section("checklist", f"{APPENDIX}checklist of the documentation", rows=rows)


def _where(point: Point, numbers: dict[str, str], lacking: Collection[str]) -> tuple[Cell, str]:
    of_run = "" if "statistics" in numbers else point.of_run
    without = point.without if point.content in lacking else ""
    left = "; ".join(words for words in (point.author, of_run, without) if words)
    present = [section for section in point.sections if section in numbers]
    if not present:
        return Cell("not provided", "bad"), left or "add it"
    return Cell(_links(present, numbers), "open" if left else "good"), left or "nothing"


def _links(sections: Sequence[str], numbers: dict[str, str]) -> Markup:
    return Markup(", ").join(Markup('<a href="#{}">{}</a>').format(key, numbers[key]) for key in sections)
