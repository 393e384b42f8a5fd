"""The building of a trajectory in three dimensions, drawn off screen by VTK: floors, low walls, stairs, exits."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np
import pyvista
import shapely
from numpy.typing import ArrayLike
from shapely.geometry.base import BaseGeometry
from vtkmodules.vtkCommonCore import vtkLogger

from evac.base.arrays import FloatArray, IntArray
from evac.building.model.building import Building, Exit, Level, Link, Place
from evac.building.model.elevation import on_level, triangles_on
from evac.building.model.marks import furniture_of, marks_of
from evac.pictures import palette
from evac.pictures.palette import PLACES
from evac.pictures.view import Camera, Label, View, aim

WALL_HEIGHT, EXIT_HEIGHT = 0.45, 0.9  # [m], low enough not to hide people
FLOOR_OPACITY = 0.8  # of floors with storeys below
MARK_OPACITY = {"slow": 0.15, "barred": 0.35, "one_way": 1.0, "control": 0.6}
PLACE_OPACITY = 0.3  # of refuges and assembly areas
DISCS = {"sign": 0.15, "fire": 0.6}  # radii of the discs of signs and fires [m]
ABOVE = 0.03  # height of marks above the ground [m]
MARGIN = {"left": 0.08, "right": 0.03, "top": 0.12, "bottom": 0.08}  # for text, as shares of the picture
LEGEND_WIDTH = 0.16
ROOM_FOR_PEOPLE = 1.9  # above the floors, within the picture [m]


def view_of(
    building: Building, size: tuple[int, int], camera: Camera, levels: Sequence[Level], margin: Mapping[str, float]
) -> View:
    """Draw levels of a building to a picture of a size [pixels], with a margin for text at each side, as `MARGIN`."""
    scene = _Scene(building, size, camera, levels, margin)
    try:
        with quiet_vtk():
            return scene.view()
    finally:
        scene.close()


@dataclass(frozen=True)
class _InSpace:
    """Parallel projection in any direction, see `evac.pictures.view.Projection`."""

    shown: IntArray
    axes: FloatArray
    zero: FloatArray
    stretch: float
    scale: float
    corner: FloatArray  # of the picture, right and up [m]

    def place(self, points: FloatArray) -> FloatArray:
        """Convert points of the building to the scene: shifted to the origin, with stretched heights."""
        return np.asarray((points - self.zero) * [1.0, 1.0, self.stretch])

    def __call__(self, level: IntArray, points: FloatArray) -> FloatArray:
        """Return column, row and nearness [pixels]."""
        right, up, toward = self.axes @ self.place(points).T
        place = self.scale * np.column_stack([right - self.corner[0], self.corner[1] - up, toward])
        place[~np.isin(level, self.shown)] = np.nan
        return place


class _Scene:
    """An off-screen VTK window with the building."""

    def __init__(
        self,
        building: Building,
        size: tuple[int, int],
        camera: Camera,
        levels: Sequence[Level],
        margin: Mapping[str, float],
    ) -> None:
        self.building, self.size, self.levels = building, size, levels
        self.rows = np.array([level.index for level in levels], np.int32)
        corners = building.vertices[np.unique(np.concatenate([level.triangles.ravel() for level in levels]))]
        # Single precision on graphics cards is too coarse far from the origin.
        zero = np.append(np.round(corners[:, :2].mean(axis=0)), corners[:, 2].min())
        aimed = aim(building, levels, camera)
        flat = _InSpace(self.rows, aimed.axes, zero, aimed.stretch, 1.0, np.zeros(2))
        placed = flat.place(corners)
        placed = np.concatenate([placed, placed + np.array([0.0, 0.0, ROOM_FOR_PEOPLE])])
        across, along, _ = aimed.axes @ placed.T
        width, height = size
        free = width * (1.0 - margin["left"] - margin["right"]), height * (1.0 - margin["top"] - margin["bottom"])
        scale = camera.zoom * min(free[0] / np.ptp(across), free[1] / np.ptp(along))
        middle = margin["left"] * width + 0.5 * free[0], margin["top"] * height + 0.5 * free[1]
        corner = np.array(
            [
                0.5 * (across.min() + across.max()) - middle[0] / scale,
                0.5 * (along.min() + along.max()) + middle[1] / scale,
            ]
        )
        self._is_stacked = len({round(level.z_min, 1) for level in levels if level.kind == "floor"}) > 1
        self.project = _InSpace(self.rows, aimed.axes, zero, aimed.stretch, scale, corner)
        self.elevation = aimed.elevation
        left = round(width * (1.0 - MARGIN["right"] - LEGEND_WIDTH + 0.02))
        self.side = (left, round(0.15 * height), round(0.99 * width), round(0.92 * height))
        with quiet_vtk():
            self.plotter = pyvista.Plotter(off_screen=True, window_size=list(size))
            self.plotter.set_background("white")
            self._add_building()
            self._aim()

    def view(self) -> View:
        """Draw the building, and again without anti-aliasing for the depth of each pixel."""
        building, plotter = self.building, self.plotter
        plotter.enable_anti_aliasing("ssaa")
        plotter.show(auto_close=False)
        image = np.array(plotter.screenshot(return_img=True))
        plotter.disable_anti_aliasing()
        for actor in plotter.actors.values():
            actor.prop.opacity = 1.0
        plotter.render()
        away = np.asarray(plotter.get_image_depth(reset_camera_clipping_range=False), np.float64)
        nearness = np.where(np.isfinite(away), self.project.scale * (away + self._distance), -np.inf)
        exits = [exit_ for exit_ in building.exits if exit_.level in self.rows]
        return View(
            image=image,
            nearness=nearness,
            project=self.project,
            scale=self.project.scale,
            elevation=self.elevation,
            labels=(*self._floor_labels(), *map(self._exit_label, exits), *map(self._place_label, self._places())),
            outlines=tuple(
                (self._colour_of(exit_), corners[:, :2]) for exit_ in exits for corners in self._strips(exit_)
            ),
            side=self.side,
            north=None if building.northward is None else self.project.axes[:2, :2] @ building.northward * [1.0, -1.0],
        )

    def close(self) -> None:
        """Release the window."""
        self.plotter.close()

    def _aim(self) -> None:
        """Set the camera to the axes and scale of the projection."""
        width, height = self.size
        right, up, toward = self.project.axes
        middle = self.project.corner + np.array([0.5 * width, -0.5 * height]) / self.project.scale
        focus = middle[0] * right + middle[1] * up
        self._distance = 1e3
        camera = self.plotter.camera
        camera.focal_point, camera.position, camera.up = focus, focus + self._distance * toward, up
        camera.parallel_projection, camera.parallel_scale = True, 0.5 * height / self.project.scale
        self.plotter.renderer.ResetCameraClippingRange()
        self.plotter.camera_set = True

    def _add_building(self) -> None:
        building = self.building
        corners = self.project.place(building.vertices)
        for kind, colour in palette.LEVELS.items():
            triangles = [level.triangles for level in self.levels if level.kind == kind]
            if triangles:
                surface = pyvista.PolyData.from_regular_faces(corners, np.concatenate(triangles))
                # Stairs and lower storeys are visible through the floors above them.
                opacity = FLOOR_OPACITY if kind == "floor" and self._is_stacked else 1.0
                self.plotter.add_mesh(surface, color=colour, lighting=False, opacity=opacity, render=False)
        here = np.isin(building.wall_level, self.rows)
        ends = building.wall_level[here].repeat(2)
        self._add_ribbon(building.walls[here], ends, palette.WALL, WALL_HEIGHT, palette.EDGE)
        for level in self.levels:
            if level.slope == 0.0 and (tops := furniture_of(level)):
                self._add_flat(level.index, shapely.multipolygons(tops), palette.FURNITURE, 1.0, WALL_HEIGHT)
        for link in building.links:
            shown = [level for level in link.levels if level in self.rows]
            if shown and (isinstance(link, Exit) or not building.is_open(link)):
                self._add_ribbon(link.segments, shown[0], self._colour_of(link))
        for mark in marks_of(building):
            if mark.level in self.rows:
                self._add_flat(mark.level, mark.shape, palette.CLOSED, MARK_OPACITY[mark.kind])
        for place in self._places():
            colour = PLACES[place.kind]
            if place.kind == "line":
                line = shapely.get_coordinates(place.shape).reshape(1, 4)
                self._add_ribbon(line, place.level, colour, ABOVE)
            else:
                is_point = place.kind in DISCS
                shape = shapely.buffer(place.shape, DISCS[place.kind]) if is_point else place.shape
                self._add_flat(place.level, shape, colour, 1.0 if is_point else PLACE_OPACITY)

    def _places(self) -> list[Place]:
        return [place for place in self.building.places if place.level in self.rows]

    def _seen(self, level: int, plan: FloatArray) -> FloatArray:
        """Return column, row and nearness (n, 3) [pixels] of points in plan (n, 2) on a level."""
        return self.project(np.full(len(plan), level, np.int32), on_level(self.building, level, plan))

    def _colour_of(self, link: Link) -> str:
        return palette.EXIT if self.building.is_open(link) else palette.CLOSED

    def _add_flat(self, level: int, shape: BaseGeometry, colour: str, opacity: float, lift: float = ABOVE) -> None:
        """Add a shape in plan, at a height above the ground of a level."""
        corners = self.project.place(triangles_on(self.building, level, shape)) + np.array([0.0, 0.0, lift])
        surface = pyvista.PolyData.from_regular_faces(corners, np.arange(len(corners)).reshape(-1, 3))
        self.plotter.add_mesh(surface, color=colour, lighting=False, opacity=opacity, render=False)

    def _add_ribbon(
        self, plan: FloatArray, level: ArrayLike, colour: str, height: float = EXIT_HEIGHT, edge_colour: str = ""
    ) -> None:
        """Add upright strips of `height` on segments in plan (s, 4), with their upper edges."""
        if not len(plan):
            return
        segments = self.project.place(on_level(self.building, level, plan.reshape(-1, 2))).reshape(-1, 2, 3)
        up = np.array([0.0, 0.0, height])
        quads = np.stack([segments[:, 0], segments[:, 1], segments[:, 1] + up, segments[:, 0] + up], axis=1)
        faces = np.arange(4 * len(segments)).reshape(-1, 4)
        strips = pyvista.PolyData.from_regular_faces(quads.reshape(-1, 3), faces)
        self.plotter.add_mesh(strips, color=colour, lighting=False, opacity=0.75, render=False)
        edges = pyvista.line_segments_from_points((segments + up).reshape(-1, 3))
        self.plotter.add_mesh(
            edges, color=edge_colour or colour, line_width=self.size[0] / 800, lighting=False, render=False
        )

    def _strips(self, exit_: Exit) -> Iterator[FloatArray]:
        """Yield the corners (4, 3) in the picture of the strip on each segment of an exit."""
        for ends in exit_.segments.reshape(-1, 2, 2):
            ground = self._seen(exit_.level, ends)
            up = self.project.scale * EXIT_HEIGHT * self.project.axes[1, 2]
            yield np.concatenate([ground, ground[::-1] - np.array([0.0, up, 0.0])])

    def _floor_labels(self) -> Iterator[Label]:
        """Yield the name of every floor at the height of its leftmost corner, left of all stairs."""
        lefts = []
        for level in self.levels:
            rows = np.unique(level.triangles)
            places = self.project(np.full(len(rows), level.index), self.building.vertices[rows])
            lefts.append(places[places[:, 0].argmin(), :2])
        column = np.min(lefts, axis=0)[0] - 0.008 * self.size[0]
        for level, (_, row) in zip(self.levels, lefts, strict=True):
            if level.kind == "floor" or len(self.levels) == 1:
                yield Label(level.name, np.array([column, row]), "rm", palette.TEXT)

    def _exit_label(self, exit_: Exit) -> Label:
        """Return the name of an exit, outside the middle of its line."""
        x1, y1, x2, y2 = exit_.segments[len(exit_.segments) // 2].tolist()
        middle = np.array([[0.5 * (x1 + x2), 0.5 * (y1 + y2)]])
        outward = np.array([[y2 - y1, x1 - x2]]) / np.hypot(x2 - x1, y2 - y1)
        here, beyond = self._seen(exit_.level, np.concatenate([middle, middle + 0.1 * outward]))[:, :2]
        way = (beyond - here) / max(float(np.linalg.norm(beyond - here)), 1e-9)
        place = here + 0.022 * self.size[1] * way
        if way[1] < 0.0:  # above the upright strip
            place[1] -= self.project.scale * EXIT_HEIGHT * self.project.axes[1, 2]
        anchor = ("l" if way[0] > 0.7 else "r" if way[0] < -0.7 else "m") + ("a" if way[1] > 0 else "d")
        return Label(self.building.label_of(exit_), place, anchor, self._colour_of(exit_))

    def _place_label(self, place: Place) -> Label:
        """Return the name of a place or a line, or the exit that a sign shows."""
        middle = np.array(place.shape.representative_point().coords)
        here = self._seen(place.level, middle)[0, :2]
        down = np.array([0.0, 0.01 * self.size[1] if place.kind in DISCS else 0.0])
        return Label(str(place), here + down, "ma" if place.kind in DISCS else "mm", PLACES[place.kind])


@contextmanager
def quiet_vtk() -> Iterator[None]:
    """Suppress VTK's message on stderr about a missing display, which it does not need."""
    before = vtkLogger.GetCurrentVerbosityCutoff()
    vtkLogger.SetStderrVerbosity(vtkLogger.VERBOSITY_ERROR)
    try:
        yield
    finally:
        vtkLogger.SetStderrVerbosity(before)
