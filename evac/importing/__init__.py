"""Files of buildings to cases that run: `evac import`."""

from evac.importing.importer import Imported, import_building

__all__ = ["Imported", "import_building"]
