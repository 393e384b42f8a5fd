"""What a documentation of an evacuation analysis should hold, point by point, and where the report has it."""

from collections.abc import Sequence
from dataclasses import dataclass

from evac.output.report.html import Cell, Html, Section, joined, link, paragraph, table


@dataclass(frozen=True)
class Point:
    """A point of the documentation.

    Attributes
    ----------
    words : str
    sections : tuple of str
        Those that have it, where they are part of the report.
    author : str
        What the author has to add; empty if nothing.
    of_run : str
        What the author has to add to the report of a single run.
    """

    words: str
    sections: tuple[str, ...]
    author: str = ""
    of_run: str = ""


POINTS = (
    Point("Project, client, author and date", ("project",), "fill in the fields"),
    Point("Purpose of the analysis, protection goals and scenarios", ("purpose",), "write the purpose"),
    Point("Documents it is based on: plans, their dates and versions", (), "name the plans that the building follows"),
    Point("Building and geometry: storeys, areas, stairs", ("building",), "confirm that it agrees with the plans"),
    Point("Doors, exits and escape routes with clear widths", ("building",)),
    Point("What is closed or not available", ("building",)),
    Point("Number of occupants and where they are", ("occupants",), "justify the numbers"),
    Point(
        "Characteristics of occupants: composition, speeds, space they take",
        ("occupants",),
        "justify the distributions; ages and impairments are not told",
    ),
    Point("Response times", ("occupants",), "justify them: alarm, organisation, kind of use"),
    Point("Routes and exits assumed, and behaviour", ("occupants",), "justify them"),
    Point("Fire, smoke and other hazards that are assumed", (), "evac has none; describe the scenario"),
    Point("Software, version and kind of model", ("model",)),
    Point("Parameters of the model and those that were changed", ("model", "case")),
    Point("Verification and validation of the software", ("verification",), "judge whether what failed matters here"),
    Point("Number of runs and seeds", ("model", "statistics"), of_run="one run does not tell how much times vary"),
    Point(
        "Evacuation times: mean and percentiles over runs, or the times of people in one run",
        ("times", "statistics"),
        of_run="make a study of many runs",
    ),
    Point("Egress curves", ("times", "statistics")),
    Point("Times of exits", ("times", "exits")),
    Point("Times of storeys and stairs", ("times", "places")),
    Point("Congestion: places, densities and durations", ("congestion", "maps")),
    Point(
        "Pictures of the course of the evacuation", ("maps",), "add pictures at chosen times, as evac render draws them"
    ),
    Point("Warnings and peculiarities of the runs", ("warnings",)),
    Point("Variants and sensitivity of the results", ("points",), "compare variants"),
    Point("Assessment: comparison with the protection goals, safety margins", ("assessment",), "write the assessment"),
    Point("Limits of the model and of the analysis", ("limits",)),
    Point("Data and files needed to repeat it", ("model", "case", "files"), "keep the file of the building"),
    Point("Signature", ("project",), "sign"),
)


def checklist_section(numbers: dict[str, str]) -> Section:
    """Return the checklist.

    Parameters
    ----------
    numbers : dict of str to str
        Number of each section of the report that is not missing, by its id.
    """
    intro = paragraph(
        "After the chapter on documentation of the RiMEA guideline (Guideline for Microscopic Evacuation Analysis,"
        " version 4.1.1). The list is our reading of it, in our words: it does not quote the guideline, and the"
        " author has to compare it."
    )
    rows = [(str(number), point.words, *_where(point, numbers)) for number, point in enumerate(POINTS, 1)]
    columns = ("no.", "point", "in this report", "left to the author")
    caption = "Numbers of sections and letters of appendices"
    return Section("checklist", "Contents of the documentation, point by point", (intro, table(caption, columns, rows)))


def _where(point: Point, numbers: dict[str, str]) -> tuple[Cell, str]:
    left = "; ".join(one for one in (point.author, "" if "statistics" in numbers else point.of_run) if one)
    present = [section for section in point.sections if section in numbers]
    if not present:
        return Cell("not provided", "bad"), left or "add it"
    return Cell(_links(present, numbers), "open" if left else "good"), left or "nothing"


def _links(sections: Sequence[str], numbers: dict[str, str]) -> Html:
    linked = [link(section, numbers[section]) for section in sections]
    return joined(linked[0], *(joined(", ", one) for one in linked[1:]))
