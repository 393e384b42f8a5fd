"""Exporter "parquet": the recorded motion as one table for pandas, Polars, DuckDB or R."""

from collections.abc import Iterable
from pathlib import Path

from evac.analysis.tables import MOTION_COLUMNS, motion_table
from evac.export.exporter import Exporter
from evac.trajectory.trajectory import Trajectory


class ParquetExporter(Exporter):
    """A Parquet table with a row for each person and recorded time."""

    name = "parquet"
    suffix = ".parquet"

    def write(self, trajectory: Trajectory, path: Path) -> Iterable[Path]:
        """Write the columns of `evac.analysis.tables.MOTION_COLUMNS`, with their units as field metadata."""
        import pyarrow
        from pyarrow import parquet

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
