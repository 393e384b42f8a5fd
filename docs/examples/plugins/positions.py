"""Writes the text files of the Pedestrian Dynamics Data Archive: person, frame, x, y and z in metres."""

import numpy as np

from evac import Exporter, Parameter


class PositionsExporter(Exporter):
    """A text table of positions, as of laboratory experiments."""

    name = "positions"
    suffix = ".txt"
    decimals = Parameter(4, "digits after the point", minimum=0, maximum=9)

    def write(self, trajectory, path):
        """Write one row for each person and recorded time."""
        rows = []
        for k in range(len(trajectory)):
            frame = trajectory[k]
            number = np.full(len(frame["person"]), k)
            rows.append(np.column_stack([frame["person"], number, frame["position"], frame["z"]]))
        table = np.concatenate([np.zeros((0, 5)), *rows])
        places = [f"%.{self.decimals}f"] * 3
        np.savetxt(path, table, ["%d", "%d", *places], header="person frame x/m y/m z/m")
        return [path]


evac_interface = 3
