"""Exporter "vtk": an animation for ParaView."""

from collections.abc import Iterable
from pathlib import Path

from evac.export.exporter import Exporter
from evac.trajectory.trajectory import Trajectory


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
