"""A plugin that closes the upper stair of the school from 10 s to 40 s."""

from evac import Change, hookimpl

evac_interface = 3


@hookimpl
def evac_prepare(simulation):
    """Announce the changes before the run."""
    simulation.scene.apply(Change(10.0, "close", "upper"))
    simulation.scene.apply(Change(40.0, "open", "upper"))
