"""The shipped cases, in the package evac_buildings."""

from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path

from evac.contract.hooks import hookimpl


@hookimpl
def evac_building_cases() -> Sequence[Path]:
    """Return the folders of evac_buildings that contain a case.toml."""
    folders = (Path(str(entry)) for entry in files("evac_buildings").iterdir())
    return sorted(folder for folder in folders if (folder / "case.toml").is_file())
