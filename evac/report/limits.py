"""Warnings of a run, and the limits of the model."""

from collections.abc import Sequence

from evac.report.html import Html, Section, heading, items, note, paragraph

#: Limits of use. The README describes them in more detail.
LIMITS = (
    "Fire, smoke, heat, toxic gas, falls and injuries are not modelled: only movement is computed. It has to be shown"
    " by other means that the available safe egress time exceeds the required safe egress time.",
    "Lifts, escalators and moving walkways are not modelled, nor are ramps or stairs that turn by more than a quarter"
    " turn in one piece.",
    "Bodies are discs of one radius in plan: shoulders do not turn, and there are no wheelchairs or bags. A crowd can"
    " block a narrow door permanently, which real people would not; such a run counts as blocked.",
    "Without a behaviour with which people keep distances, they walk at their full desired speed until bodies touch:"
    " flows through doors are then higher than measured ones, and flows on stairs several times higher. Flows and times"
    " of such runs must not be used as design values. With the one of evac, flows through doors are lower than those of"
    " laboratories, and queues there last rather too long.",
    "People know the building: nobody explores, misreads a sign or turns back, unless a behaviour in use models it.",
    "Response times, speeds and numbers of people are assumptions of the case, on which the results depend.",
    "One run is one sample of all random quantities. It does not show the variation of times; a study of many runs"
    " does.",
    "evac has not been validated for the certification of buildings. This report lists the tests that it fails.",
)


def warnings_section(quality: Sequence[object], building: Sequence[str]) -> Section:
    """Return the section on quality warnings and on warnings of building and people."""
    parts: list[Html] = [heading("Quality warnings: numerical or physical problems of the results")]
    parts.append(note("bad", items(quality)) if quality else paragraph("None."))
    parts.append(heading("Warnings about building and people, before the run"))
    parts.append(note("open", items(building)) if building else paragraph("None."))
    return Section("warnings", "Warnings", tuple(parts))


def limits_section(is_study: bool) -> Section:
    """Return the section on limits of use."""
    limits = [limit for limit in LIMITS if not (is_study and limit.startswith("One run"))]
    return Section("limits", "Limits of use", (items(limits),))
