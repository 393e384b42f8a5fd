"""Stability: what every contact model makes of stiff and extreme cases, cell by cell, beside the theory."""

import csv
import time
from collections import Counter

from evac.evidence.report import Evidence
from evac.evidence.stability.crowds import dissipation, reported_force, standing, static_overlap
from evac.evidence.stability.dem import hardened_contacts, network_limits, stiffness_map
from evac.evidence.stability.extremes import extreme_scenes
from evac.evidence.stability.steps import mass_map, overlap_order, radius_map, speed_map, tau_map
from evac.evidence.stability.trial import MEANINGS, VERDICTS, WRONG

SECTIONS = {
    "DEM: stiffness and step": (stiffness_map, network_limits, static_overlap, hardened_contacts),
    "Relaxation time and step": (tau_map,),
    "NSM2: dissipation from zero to infinity": (dissipation,),
    "Walking speed and step": (speed_map, overlap_order),
    "Ratio of masses": (mass_map,),
    "Ratio of radii": (radius_map,),
    "Standing crowds stand": (standing, reported_force),
    "Extreme scenes": (extreme_scenes,),
}


def run(evidence: Evidence) -> None:
    """Compute all maps and scenes and write the page."""
    start = time.time()
    evidence.text("Every cell of every map, and every scene, is one of:")
    for kind, meaning in MEANINGS.items():
        evidence.text(f"- **{kind}**: {meaning}.")
    for heading, parts in SECTIONS.items():
        evidence.heading(heading)
        for part in parts:
            part(evidence)
    evidence.finding(_in_one_sentence(evidence, start), "dem_stiffness", "DEM over stiffness and step")
    evidence.write_page("Stability on stiff and extreme cases")


def _in_one_sentence(evidence: Evidence, start: float) -> str:
    """Return the sums of all verdicts in the tables written since `start`, a time of the clock [s]."""
    counts: Counter[str] = Counter()
    for path in evidence.folder.glob("*.csv"):
        if path.stat().st_mtime >= start - 1.0:
            with path.open(newline="", encoding="utf-8") as file:
                counts.update(row["verdict"] for row in csv.DictReader(file) if "verdict" in row)
    told = ", ".join(f"{counts[kind]} {kind}" for kind in VERDICTS if kind != WRONG)
    return f"Of {counts.total()} cells and scenes {counts[WRONG]} are wrong; {told}."
