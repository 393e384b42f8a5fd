"""Doses of gases and heat: their rates, after FDS, the SFPE Handbook and ISO 13571.

The dose of gases and that of heat are never added. Equations and sources are those of docs/fire_data.md.
"""

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from evac.base.arrays import FloatArray
from evac.conditions.source import IRRITANTS

if TYPE_CHECKING:
    from evac.case.schema import DoseSettings

#: Volume of air per minute [l/min], and carboxyhaemoglobin at incapacitation [%], by activity.
ACTIVITY = {"rest": (8.5, 40.0), "light": (25.0, 30.0), "heavy": (50.0, 20.0)}

#: Doses of irritants that are lethal [ppm min].
LETHAL = dict(zip(IRRITANTS, (114e3, 114e3, 87e3, 12e3, 1900.0, 4500.0, 22500.0), strict=True))

#: Concentrations of irritants that incapacitate, after the SFPE Handbook and as in FDS, and after ISO 13571 [ppm].
INCAPACITATING = dict(zip(IRRITANTS, (900.0, 900.0, 900.0, 120.0, 350.0, 20.0, 30.0), strict=True))
COMPROMISING = dict(zip(IRRITANTS, (1000.0, 1000.0, 500.0, 150.0, 250.0, 30.0, 250.0), strict=True))

#: Quantities that each form of the dose of gases needs; others count if the data have them.
NEEDED = {"fds": ("co", "co2", "o2"), "sfpe": ("co", "co2", "o2"), "iso": ("co", "co2")}

#: Quantities that count in each form.
ALL = ("co", "co2", "o2", "hcn", "no", *IRRITANTS)
COUNTED = {"fds": ALL, "sfpe": ALL, "iso": ("co", "co2", "hcn")}

#: Radiative flux below which there is no limit of time [kW/m2], and dose that can be tolerated [(kW/m2)^1.33 min].
LEAST_FLUX, TOLERANCE = 2.5, 1.33

LITTLE_OXYGEN = 20.0  #: Oxygen below which its lack counts [%].
MINUTE = 60.0  #: Seconds of a minute: rates of doses are stated per minute.

Air = Mapping[str, FloatArray]


def dose_rates(dose: "DoseSettings", air: Air) -> FloatArray:
    """Return the rates (2, n) of the doses of gases and of heat [1/s] in air that has at least one quantity (n,)."""
    own = {name: values for name, values in air.items() if name not in dose.without}
    nothing = np.zeros_like(next(iter(air.values())))
    gas = gas_rate(dose.form, dose.activity, own) if own else nothing
    heat = heat_rate(dose.heat, own) if dose.heat != "none" and "temperature" in own else nothing
    return np.stack([gas, heat]) / MINUTE


def irritant_scale(dose: "DoseSettings | None") -> Mapping[str, float]:
    """Return the concentrations over which those of irritants are summed for a form of the dose [ppm]."""
    return COMPROMISING if dose is not None and dose.form == "iso" else INCAPACITATING


def gas_rate(form: str, activity: str, air: Air) -> FloatArray:
    """Return the rate (n,) of the fractional effective dose of gases [1/min] by form and activity, unused by "iso".

    The air has concentrations (n,) by quantity; those that it lacks have no effect.
    """
    nothing = np.zeros_like(next(iter(air.values())))
    volume, limit = ACTIVITY[activity]
    co, co2, hcn, no, no2 = (air.get(name, nothing) for name in ("co", "co2", "hcn", "no", "no2"))
    if form == "iso":
        rate = co / 35000.0 + hcn**2.36 / 1.2e6
        return rate * np.where(co2 > 2.0, np.exp(co2 / 5.0), 1.0)
    rate = 3.317e-5 * co**1.036 * (volume / limit)
    cyanide = np.maximum(hcn - no - no2, 0.0)
    if form == "fds":
        rate += (np.exp(cyanide / 43.0) - 1.0) / 220.0
        breath = np.where(co2 > 0.0, np.exp(0.1903 * co2 + 2.0004) / 7.1, 1.0)
    else:
        rate += cyanide**2.36 / 1.2e6
        breath = np.minimum(np.exp(co2 / 5.0), max(1.0, 70.0 / volume))
    rate += (no + no2) / 1500.0
    for name in IRRITANTS:
        if name in air:
            rate += air[name] / LETHAL[name]
    rate *= breath
    if "o2" in air:
        lack = np.exp(0.54 * (20.9 - air["o2"]) - 8.13)
        rate += np.where(air["o2"] < LITTLE_OXYGEN, lack, 0.0)
    return rate


def irritant_concentration(air: Air, scale: Mapping[str, float] = INCAPACITATING) -> FloatArray:
    """Return the fractional irritant concentration (n,), the sum of concentrations over those of a scale."""
    nothing = np.zeros_like(next(iter(air.values())))
    return sum((air[name] / scale[name] for name in IRRITANTS if name in air), nothing)


def heat_rate(form: str, air: Air) -> FloatArray:
    """Return the rate (n,) of the dose of heat [1/min]: of hot air, and of radiation if its flux is known.

    The form is "clothed", "unclothed" or "design"; temperatures (n,) are in C, fluxes in kW/m2.
    """
    hot = np.maximum(air["temperature"], 1.0)
    if form == "clothed":
        rate = hot**3.61 / 4.1e8
    elif form == "unclothed":
        rate = hot**3.4 / 5e7
    else:
        rate = 1.0 / (2e31 * hot**-16.963 + 4e8 * hot**-3.7561)
    if "radiation" in air:
        flux = air["radiation"]
        rate = rate + np.where(flux >= LEAST_FLUX, np.maximum(flux, 0.0) ** 1.33 / TOLERANCE, 0.0)
    return rate
