"""The exceptions of evac: one root, one class for each kind of cause."""


class EvacError(Exception):
    """Root of every exception that evac raises on purpose."""


class BuildingError(EvacError):
    """A mesh file or the building read from it cannot be used; names the file and the place."""


class ScenarioError(EvacError):
    """A case.toml or an override is wrong; names the file, the dotted key and the way out."""


class PluginError(EvacError):
    """A plugin cannot be found, loaded or configured, or breaks its contract."""


class SimulationError(EvacError):
    """A run cannot go on; names time, people, place and what to change."""


class ResultError(EvacError):
    """A result folder or a trajectory file cannot be read or written."""
