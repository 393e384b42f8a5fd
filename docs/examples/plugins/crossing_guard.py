"""Notes how many people are inside, refuses nights, and says by which exit people left."""

import numpy as np

from evac import Recorder, ScenarioError, hookimpl


class Inside(Recorder):
    """Writes `inside.csv`: time [s], people inside."""

    name = "inside"

    def start(self, simulation):
        """Start a table."""
        self.rows = []

    def record(self, simulation):
        """Add a row."""
        self.rows.append((simulation.time, simulation.population.inside))

    def state(self):
        """Return the rows, for checkpoints."""
        return {"rows": np.array(self.rows)}

    def restore(self, simulation, state):
        """Go on with the rows of a checkpoint; called in place of `start`."""
        self.rows = state["rows"].tolist()

    def finish(self, simulation, results):
        """Write the table, if the run has a folder and got as far as a first row."""
        if simulation.folder is not None and getattr(self, "rows", None):
            table = np.array(self.rows)
            np.savetxt(simulation.folder / "inside.csv", table, "%g", ",", header="time,inside", comments="")


evac_interface = 3


@hookimpl
def evac_configure(case):
    """Refuse a case before anything is built."""
    if "night" in case.title:
        raise ScenarioError(f"{case.source}: title: nobody is in at night; take a case by day")


@hookimpl
def evac_metrics(results):
    """Count who left by which exit; summary.json gets it under this plugin's name."""
    used = results.crowd.exit_used
    return {exit.name: int(np.count_nonzero(used == exit.index)) for exit in results.building.exits}
