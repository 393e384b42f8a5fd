"""Warnings of a run, and what evac does not compute."""

from collections.abc import Sequence

from evac.output.report.html import Html, Section, heading, items, note, paragraph

#: What the results must not be taken for. The README says the same at more length.
LIMITS = (
    "No fire, smoke, heat or toxic gas, and nobody falls or gets hurt: movement is computed, not harm. Whether the"
    " time available is longer than the time required has to be shown by other means.",
    "No lifts, escalators or moving walkways, and no ramp or stair that turns by more than a quarter in one piece.",
    "Bodies are discs of one radius in plan: no shoulders that turn, no wheelchairs, no bags. A crowd can block a"
    " narrow door for good, which people would not; a run in which it does counts as blocked.",
    "Without the behaviour headway people walk at full speed until bodies touch: a crowd passes doors faster than"
    " measured ones, and stairs several times faster. Then flows and times are no design values.",
    "People know the way: nobody explores, misreads a sign or turns back, unless a behaviour in use says so.",
    "Response times, speeds and numbers of people are assumptions of the case; results are no better than these.",
    "One run is one draw of everything random. It does not say how much times vary, as a study of many runs does.",
    "evac has not been validated for certifying a building. The tests that fail are listed in this report.",
)


def warnings_section(quality: Sequence[object], building: Sequence[str]) -> Section:
    """Return the section on quality warnings and on warnings of building and people."""
    parts: list[Html] = [heading("Quality warnings: what the numbers say against the results")]
    parts.append(note("bad", items(quality)) if quality else paragraph("None."))
    parts.append(heading("Warnings of building and people, before the run"))
    parts.append(note("open", items(building)) if building else paragraph("None."))
    return Section("warnings", "Warnings", tuple(parts))


def limits_section(is_study: bool) -> Section:
    """Return the section on limits of use."""
    limits = [limit for limit in LIMITS if not (is_study and limit.startswith("One run"))]
    return Section("limits", "Limits of use", (items(limits),))
