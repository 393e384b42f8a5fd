"""The quantities of the air: names, units, and values of clear air."""

from dataclasses import dataclass
from types import MappingProxyType


@dataclass(frozen=True)
class Quantity:
    """A scalar of the air that sources provide.

    Attributes
    ----------
    unit : str
    clear : float
        Value of clear air, where no source applies.
    least, most : float
        Range of values.
    doc : str
    """

    unit: str
    clear: float
    least: float
    most: float
    doc: str


def _ppm(doc: str) -> Quantity:
    return Quantity("ppm", 0.0, 0.0, 1e6, doc)


#: All quantities by name. Concentrations are those of volumes.
QUANTITIES = MappingProxyType(
    {
        "extinction": Quantity("1/m", 0.0, 0.0, 1e4, "extinction coefficient K of smoke"),
        "co": _ppm("carbon monoxide"),
        "co2": Quantity("%", 0.0, 0.0, 100.0, "carbon dioxide"),
        "o2": Quantity("%", 20.9, 0.0, 100.0, "oxygen"),
        "hcn": _ppm("hydrogen cyanide"),
        "no": _ppm("nitric oxide"),
        "no2": _ppm("nitrogen dioxide"),
        "hcl": _ppm("hydrogen chloride"),
        "hbr": _ppm("hydrogen bromide"),
        "hf": _ppm("hydrogen fluoride"),
        "so2": _ppm("sulphur dioxide"),
        "acrolein": _ppm("acrolein"),
        "formaldehyde": _ppm("formaldehyde"),
        "temperature": Quantity("C", 20.0, -273.15, 5000.0, "temperature of the air"),
        "radiation": Quantity("kW/m2", 0.0, 0.0, 1e4, "radiative flux onto a surface"),
    }
)

#: The irritant gases.
IRRITANTS = ("hcl", "hbr", "hf", "so2", "no2", "acrolein", "formaldehyde")
