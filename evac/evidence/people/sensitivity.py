"""What each number of the default movement model changes: measures of some scenes with it 10 % greater and smaller."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from scipy.stats import t as student

from evac.base.arrays import FloatArray
from evac.contract.registry import Registry
from evac.evidence.evidence import Evidence, Row
from evac.evidence.people.runs import DEFAULT, MODELS, walked
from evac.evidence.people.scenes import NARROW_DOOR, STAIR_DOWN, TWO_WAY_4, corner_name, door_name, file_name
from evac.study.statistics import CONFIDENCE

#: Share by which a number is changed, and seeds of each scene.
SHARE, RUNS = 0.1, 6

#: The measure of each scene that is compared.
COMPARED: Mapping[str, str] = {
    NARROW_DOOR: "flow [1/s]",
    door_name(1.0): "flow per metre [1/s/m]",
    STAIR_DOWN: "flow per metre [1/s/m]",
    TWO_WAY_4: "speed [m/s]",
    corner_name(2.4): "beside the straight corridor [-]",
    file_name(0.5): "distance [m]",
}


def measure_sensitivity(evidence: Evidence) -> list[Row]:
    """Return a row for each number, with the change of each measure [%]."""
    declared = Registry().get("behaviour", DEFAULT).declared()
    numbers = {name: float(item.default) for name, item in declared.items() if isinstance(item.default, float)}
    tasks = [
        (scene, {name: value * factor}, evidence.seed + seed)
        for name, value in numbers.items()
        for scene in COMPARED
        for seed in range(RUNS)
        for factor in (1.0 + SHARE, 1.0 - SHARE)
    ]
    found = np.array(evidence.map(measure, tasks)).reshape(len(numbers), len(COMPARED), RUNS, 2)
    changes = 100.0 * (found[..., 0] - found[..., 1]) / (found[..., 0] + found[..., 1])
    rows: list[Row] = []
    for (name, value), own in zip(numbers.items(), changes, strict=True):
        cells = {scene: _cell(change) for scene, change in zip(COMPARED, own, strict=True)}
        rows.append({"parameter": name, "value": value, "unit": declared[name].unit} | cells)
    return rows


def measure(scene: str, parameters: Mapping[str, Any], seed: int) -> float:
    """Return the measure of a scene with other parameters; NaN if people are left."""
    values, _ = walked(scene, {DEFAULT: parameters}, MODELS[0], seed)
    return values.get(COMPARED[scene], float("nan"))


def _cell(changes: FloatArray) -> str:
    if np.isnan(changes).any():
        return "blocked"
    half = student.ppf(0.5 + 0.5 * CONFIDENCE, len(changes) - 1) * changes.std(ddof=1) / math.sqrt(len(changes))
    return f"{changes.mean():+.1f} ± {half:.1f}"
