"""Exporter "csv": the recorded motion as one CSV table."""

import csv
from collections.abc import Iterable
from pathlib import Path

from evac.analysis.tables import motion_table
from evac.export.exporter import Exporter
from evac.folder.textfiles import cell_of
from evac.trajectory.trajectory import Trajectory


class CsvExporter(Exporter):
    """A CSV table with a row for each person and recorded time."""

    name = "csv"
    suffix = ".csv"

    def write(self, trajectory: Trajectory, path: Path) -> Iterable[Path]:
        """Write the columns of `evac.analysis.tables.MOTION_COLUMNS`."""
        table = motion_table(trajectory)
        with path.open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            writer.writerow(table)
            rows = zip(*(column.tolist() for column in table.values()), strict=True)
            writer.writerows(map(cell_of, row) for row in rows)
        return [path]
