"""Stability of every contact model in stiff and extreme cases, compared with the theory."""

from collections import Counter

from evac.evidence.evidence import Evidence
from evac.evidence.stability.crowds import dissipation, reported_force, standing, static_overlap
from evac.evidence.stability.dem import network_limits, stiffness_map
from evac.evidence.stability.extremes import extreme_scenes
from evac.evidence.stability.steps import mass_map, overlap_order, radius_map, speed_map, tau_map
from evac.evidence.stability.trials import VERDICTS, WRONG
from evac.evidence.verdicts import all_of, reported

SECTIONS = {
    "DEM: stiffness and step": (stiffness_map, network_limits, static_overlap),
    "Relaxation time and step": (tau_map,),
    "NSM2: dissipation from zero to infinity": (dissipation,),
    "Walking speed and step": (speed_map, overlap_order),
    "Ratio of masses": (mass_map,),
    "Ratio of radii": (radius_map,),
    "Standing crowds": (standing, reported_force),
    "Extreme scenes": (extreme_scenes,),
}


def run(evidence: Evidence) -> None:
    """Make all maps and scenes and write the page."""
    evidence.show("page", __name__)
    kinds: Counter[str] = Counter()
    for heading, parts in SECTIONS.items():
        evidence.add(f"## {heading}")
        here = [kind for part in parts for kind in part(evidence)]
        if here:
            evidence.verdict(all_of(f"{heading}: cells not wrong", len(here) - here.count(WRONG), len(here), heading))
        kinds.update(here)
    text = ", ".join(f"{kinds[kind]} {kind}" for kind in VERDICTS)
    evidence.verdict(reported("All cells and scenes", text, "0 wrong", "Verdicts on cells and scenes"))
    evidence.write_page(__name__)
