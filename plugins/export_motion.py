"""Exporters of the recorded motion: tables "csv" and "parquet", and the animation "vtk" for ParaView."""

import csv
from collections.abc import Iterable
from pathlib import Path

import pyarrow
from pyarrow import parquet

from evac.analysis.tables import MOTION_COLUMNS, motion_table
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


class ParquetExporter(Exporter):
    """A Parquet table with a row for each person and recorded time, for pandas, Polars, DuckDB or R."""

    name = "parquet"
    suffix = ".parquet"

    def write(self, trajectory: Trajectory, path: Path) -> Iterable[Path]:
        """Write the columns of `evac.analysis.tables.MOTION_COLUMNS`, with their units as field metadata."""
        columns = motion_table(trajectory)
        words = pyarrow.dictionary(pyarrow.int32(), pyarrow.string())
        arrays = [
            pyarrow.array(values).cast(words) if values.dtype == object else pyarrow.array(values)
            for values in columns.values()
        ]
        fields = [
            pyarrow.field(name, array.type, metadata={"unit": MOTION_COLUMNS[name]})
            for name, array in zip(columns, arrays, strict=True)
        ]
        parquet.write_table(pyarrow.table(arrays, schema=pyarrow.schema(fields)), path)
        return [path]


class VtkExporter(Exporter):
    """An animation for ParaView: the people in each frame, and the building in named blocks."""

    name = "vtk"

    def write(self, trajectory: Trajectory, path: Path) -> Iterable[Path]:
        """Write ``animation.pvd`` and the files that it refers to."""
        from evac.export.vtk import export_vtk

        return [export_vtk(trajectory, path)]

    def place(self, trajectory: Trajectory) -> Path:
        """Return the result folder, to which a run with ``output.animation`` writes the same files."""
        return trajectory.path.parent
