"""Import of building files as cases: `evac import`."""

from evac.importing.importing import Imported, import_building

__all__ = ["Imported", "import_building"]
