"""The scene of a trajectory in three dimensions, drawn off screen: floors, low walls, stairs, exits, people."""

import textwrap
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import matplotlib
import numpy as np
import pyvista
import shapely
from numpy.typing import NDArray
from vtkmodules.vtkCommonCore import vtkLogger

from evac.arrays import FloatArray
from evac.building.elevation import elevation
from evac.building.model import Building
from evac.output.trajectory import Trajectory
from evac.output.vtk_export import segments_in_space

#: What people can be coloured by.
COLOURS = ("group", "speed")

LEVEL_COLOUR = {"floor": "#e7ebf0", "flight": "#f3cf95", "landing": "#f7e2bf"}
WALL_COLOUR, EDGE_COLOUR, TEXT_COLOUR = "#c3cad3", "#7b8794", "#27313d"
EXIT_COLOUR, CLOSED_COLOUR = "#12a150", "#c0392b"
TOP_COLOUR, FURNITURE = "#d9bf9b", 4.0  # of tables and the like; their greatest area [m2]
WALL_HEIGHT, EXIT_HEIGHT = 0.45, 0.9  # [m], low enough to look over
PERSON_HEIGHT, PERSON_RADIUS = 1.6, 0.22  # of the figure [m]; it is scaled to each body
ELEVATION_FLAT, ELEVATION = np.radians(58.0), np.radians(36.0)  # of the view on one storey, on several
TURN = np.radians(20.0)  # of the view off the short side of the building
CLEARANCE = 0.75  # of a storey seen past the one above
MARGIN = {"left": 0.08, "right": 0.03, "top": 0.12, "bottom": 0.05}  # of the picture, for the writing
LEGEND_WIDTH, LEGEND_GROUPS = 0.15, 20


class Scene:
    """A window off screen with the building in it; `show` puts the people of one frame there.

    Parameters
    ----------
    trajectory : Trajectory
    size : tuple of int
        Width and height of the picture [pixels].
    stretch : float or None
        Factor on heights that pulls storeys apart; None: as much as it takes to look into every storey.
    colour_by : str
        ``"group"`` or ``"speed"``.
    """

    def __init__(self, trajectory: Trajectory, size: tuple[int, int], stretch: float | None, colour_by: str) -> None:
        self.trajectory = trajectory
        self.size = size
        self.colour_by = colour_by
        building = trajectory.building
        self._zero = np.append(trajectory.origin, building.vertices[:, 2].min())
        self._view = _view_axes(building)
        self.stretch = _clear_stretch(building, self._view) if stretch is None else stretch
        with quiet_vtk():
            self.plotter = pyvista.Plotter(off_screen=True, window_size=list(size))
            self.plotter.set_background("white")
            self.plotter.enable_anti_aliasing("ssaa")
            self._add_building(building)
            self._aim()
            self._add_writing()
            self._pawn = _pawn()
            self.plotter.show(auto_close=False)

    def show(self, k: int) -> NDArray[np.uint8]:
        """Return the picture of frame `k`, (height, width, 3)."""
        trajectory, plotter = self.trajectory, self.plotter
        frame = trajectory.frame(k)
        plotter.remove_actor("people", render=False)
        if len(frame["person"]):
            people = pyvista.PolyData(self._place(np.column_stack([frame["position"], frame["z"]])))
            people["radius"] = trajectory.radius[frame["person"]]
            if self.colour_by == "group":
                people["colour"] = self._group_colours[trajectory.group[frame["person"]]]
            else:
                people["speed"] = frame["speed"]
            glyphs = people.glyph(geom=self._pawn, scale="radius", orient=False)
            plotter.add_mesh(glyphs, name="people", ambient=0.6, diffuse=0.5, render=False, **self._person_style())
        out = trajectory.people - len(frame["person"])
        self._clock.SetInput(f"t = {frame['time']:.1f} s      {out} of {trajectory.people} out")
        plotter.render()
        return np.asarray(plotter.screenshot(return_img=True))

    def close(self) -> None:
        """Free the window."""
        self.plotter.close()

    def _place(self, points: FloatArray) -> FloatArray:
        """Return points of the building as points of the scene: near the origin, storeys pulled apart."""
        return np.asarray((points - self._zero) * [1.0, 1.0, self.stretch])

    def _add_building(self, building: Building) -> None:
        corners = self._place(building.vertices)
        for kind, colour in LEVEL_COLOUR.items():
            triangles = [level.triangles for level in building.levels if level.kind == kind]
            if triangles:
                surface = pyvista.PolyData.from_regular_faces(corners, np.concatenate(triangles))
                self.plotter.add_mesh(surface, color=colour, lighting=False, render=False)
        walls = self._place(segments_in_space(building, building.walls, building.wall_level))
        self._add_ribbon(walls, WALL_HEIGHT, WALL_COLOUR, EDGE_COLOUR)
        self._add_tops(building)
        for exit_ in building.exits:
            self._add_link(exit_.segments, exit_.level, is_open=building.is_open(exit_))
        for portal in building.portals:
            if not building.is_open(portal):
                self._add_link(portal.segments, portal.levels[0], is_open=False)

    def _add_link(self, segments: FloatArray, level: int, *, is_open: bool) -> None:
        """Add a strip on the segments of an exit or of a closed portal."""
        colour = EXIT_COLOUR if is_open else CLOSED_COLOUR
        ends = segments_in_space(self.trajectory.building, segments, np.full(len(segments), level))
        self._add_ribbon(self._place(ends), EXIT_HEIGHT, colour, colour)

    def _add_tops(self, building: Building) -> None:
        """Close the holes of flat levels that are as small as furniture at the height of the walls around them."""
        for level in building.levels:
            if level.slope > 0.0:
                continue
            for part in shapely.get_parts(level.polygon):
                for hole in map(shapely.Polygon, shapely.get_rings(part)[1:]):
                    if hole.area > FURNITURE:
                        continue
                    for piece in shapely.get_parts(shapely.constrained_delaunay_triangles(hole)):
                        corners = np.column_stack([shapely.get_coordinates(piece)[:3], np.full(3, level.z_min)])
                        top = pyvista.Triangle(self._place(corners) + np.array([0.0, 0.0, WALL_HEIGHT]))
                        self.plotter.add_mesh(top, color=TOP_COLOUR, lighting=False, render=False)

    def _add_ribbon(self, segments: FloatArray, height: float, colour: str, edge_colour: str) -> None:
        """Add upright strips of `height` on `segments` (s, 2, 3), with their upper edges."""
        if not len(segments):
            return
        up = np.array([0.0, 0.0, height])
        quads = np.stack([segments[:, 0], segments[:, 1], segments[:, 1] + up, segments[:, 0] + up], axis=1)
        faces = np.arange(4 * len(segments)).reshape(-1, 4)
        strips = pyvista.PolyData.from_regular_faces(quads.reshape(-1, 3), faces)
        self.plotter.add_mesh(strips, color=colour, lighting=False, opacity=0.75, render=False)
        edges = pyvista.line_segments_from_points((segments + up).reshape(-1, 3))
        self.plotter.add_mesh(edges, color=edge_colour, line_width=self.size[0] / 800, lighting=False, render=False)

    @property
    def _has_legend(self) -> bool:
        return self.colour_by == "speed" or 1 < len(self.trajectory.groups) <= LEGEND_GROUPS

    def _aim(self) -> None:
        """Fit the building into the part of the picture that no writing takes, in parallel projection."""
        building = self.trajectory.building
        right, up, toward = self._view
        corners = self._place(building.vertices)
        corners = np.concatenate([corners, corners + np.array([0.0, 0.0, PERSON_HEIGHT])])
        across, along = corners @ right, corners @ up
        width, height = self.size
        left = MARGIN["left"]
        right_side = MARGIN["right"] + LEGEND_WIDTH if self._has_legend else left
        free_width, free_height = 1.0 - left - right_side, 1.0 - MARGIN["top"] - MARGIN["bottom"]
        full_height = max(np.ptp(along) / free_height, np.ptp(across) / free_width * height / width)
        full_width = full_height * width / height
        centre_across = 0.5 * (across.min() + across.max()) + 0.5 * (right_side - left) * full_width
        centre_along = 0.5 * (along.min() + along.max()) + 0.5 * (MARGIN["top"] - MARGIN["bottom"]) * full_height
        focus = centre_across * right + centre_along * up
        camera = self.plotter.camera
        camera.focal_point, camera.position, camera.up = focus, focus + 1e3 * toward, up
        camera.parallel_projection, camera.parallel_scale = True, 0.5 * full_height
        self.plotter.renderer.ResetCameraClippingRange()
        self.plotter.camera_set = True

    def _add_writing(self) -> None:
        """Add title, clock, names of floors and exits, and the legend."""
        plotter, height = self.plotter, self.size[1]
        title = textwrap.shorten(str(self.trajectory.header["title"]), 90, placeholder=" ...")
        style = {"color": TEXT_COLOUR, "viewport": True, "render": False}
        plotter.add_text(title, position=(0.02, 0.95), font_size=round(height / 75), **style)
        self._clock = plotter.add_text(" ", position=(0.02, 0.905), font_size=round(height / 85), **style)
        self._add_labels(*_floor_labels(self.trajectory.building, self._view[0]), TEXT_COLOUR, "right")
        for is_open, colour in ((True, EXIT_COLOUR), (False, CLOSED_COLOUR)):
            self._add_labels(*_exit_labels(self.trajectory.building, is_open), colour, "center")
        self._group_colours = _group_colours(len(self.trajectory.groups))
        if self.colour_by == "group" and self._has_legend:
            names = [(name, tuple(self._group_colours[i] / 255)) for i, name in enumerate(self.trajectory.groups)]
            legend = plotter.add_legend(names, bcolor=None, face="circle", loc=None)
            tall = min(0.8, 0.032 * len(names))
            legend.SetPosition(1.0 - LEGEND_WIDTH - 0.01, 0.5 - 0.5 * tall)
            legend.SetPosition2(LEGEND_WIDTH, tall)
            legend.GetEntryTextProperty().SetColor(pyvista.Color(TEXT_COLOUR).float_rgb)

    def _add_labels(self, points: FloatArray, words: list[str], colour: str, justification: str) -> None:
        if not words:
            return
        self.plotter.add_point_labels(
            self._place(points),
            words,
            shape=None,
            show_points=False,
            always_visible=True,
            font_size=round(self.size[1] / 60),
            text_color=colour,
            justification_horizontal=justification,
            render=False,
        )

    def _person_style(self) -> dict[str, Any]:
        if self.colour_by == "group":
            return {"scalars": "colour", "rgb": True}
        bar = {"title": "speed [m/s]", "vertical": True, "position_x": 0.9, "position_y": 0.3, "color": TEXT_COLOUR}
        return {"scalars": "speed", "cmap": "viridis", "clim": (0.0, 2.0), "scalar_bar_args": bar}


@contextmanager
def quiet_vtk() -> Iterator[None]:
    """Keep VTK from writing to stderr that there is no display: it then draws without one."""
    before = vtkLogger.GetCurrentVerbosityCutoff()
    vtkLogger.SetStderrVerbosity(vtkLogger.VERBOSITY_ERROR)
    try:
        yield
    finally:
        vtkLogger.SetStderrVerbosity(before)


def _view_axes(building: Building) -> FloatArray:
    """Return unit vectors to the right, up and towards the eye, (3, 3): a look across the building's short side."""
    extent = np.ptp(building.vertices, axis=0)
    azimuth = -np.pi / 2 + TURN if extent[0] >= extent[1] else TURN
    ground = np.array([np.cos(azimuth), np.sin(azimuth)])
    elevation_angle = ELEVATION if len(_floor_heights(building)) > 1 else ELEVATION_FLAT
    toward = np.append(np.cos(elevation_angle) * ground, np.sin(elevation_angle))
    right = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
    return np.array([right, np.cross(toward, right), toward])


def _floor_heights(building: Building) -> FloatArray:
    """Return the different heights of the floors, ascending [m]."""
    return np.unique(np.round([level.z_min for level in building.levels if level.kind == "floor"], 1))


def _clear_stretch(building: Building, view: FloatArray) -> float:
    """Return the factor on heights at which no storey hides much of the one below."""
    heights = _floor_heights(building)
    if len(heights) < 2:
        return 1.0
    depth = np.ptp(building.vertices[:, :2] @ view[1, :2])
    return max(1.0, float(CLEARANCE * depth / (np.diff(heights).min() * view[1, 2])))


def _pawn() -> pyvista.PolyData:
    """Return a person of radius 1 at the shoulders, a surface of revolution to be scaled by the body radius."""
    tall = PERSON_HEIGHT / PERSON_RADIUS
    turn = np.linspace(-0.4 * np.pi, 0.5 * np.pi, 6)
    head = 0.6
    radius = np.concatenate([[0.55, 0.97, 1.0, 0.85], head * np.cos(turn)])
    height = np.concatenate([[0.0, 0.66 * tall, 0.72 * tall, 0.77 * tall], tall - head + head * np.sin(turn)])
    sides, rows = 12, len(radius)
    angle = 2.0 * np.pi * np.arange(sides) / sides
    points = np.stack(
        [np.outer(radius, np.cos(angle)), np.outer(radius, np.sin(angle)), np.outer(height, np.ones(sides))], axis=-1
    )
    row, side = np.meshgrid(sides * np.arange(rows - 1), np.arange(sides), indexing="ij")
    after = (side + 1) % sides
    faces = np.stack([row + side, row + after, row + sides + after, row + sides + side], axis=-1).reshape(-1, 4)
    return pyvista.PolyData.from_regular_faces(points.reshape(-1, 3), faces).compute_normals(cell_normals=False)


def _group_colours(count: int) -> NDArray[np.uint8]:
    """Return one colour for each group and, last, grey for people of none: (count + 1, 3)."""
    table = np.array(matplotlib.color_sequences["tab10" if count <= 10 else "tab20"])
    colours = np.vstack([table[np.arange(count) % len(table)], [[0.5, 0.5, 0.5]]])
    return (255 * colours).round().astype(np.uint8)


def _floor_labels(building: Building, right: FloatArray) -> tuple[FloatArray, list[str]]:
    """Return the leftmost corner of every floor in the view, and the floor's name."""
    floors = [level for level in building.levels if level.kind == "floor"]
    corners = [building.vertices[np.unique(level.triangles)] for level in floors]
    points = np.array([corner[(corner @ right).argmin()] for corner in corners]).reshape(-1, 3)
    return points, [f"{level.name}  " for level in floors]


def _exit_labels(building: Building, is_open: bool) -> tuple[FloatArray, list[str]]:
    """Return a point outside the middle of every open or every closed exit, and the exit's name."""
    exits = [exit_ for exit_ in building.exits if building.is_open(exit_) == is_open]
    ends = np.array([e.segments[len(e.segments) // 2] for e in exits]).reshape(-1, 4)
    middles = 0.5 * (ends[:, :2] + ends[:, 2:])
    along = ends[:, 2:] - ends[:, :2]
    outward = np.column_stack([along[:, 1], -along[:, 0]]) / np.linalg.norm(along, axis=1)[:, None]
    z = elevation(building, np.array([e.level for e in exits], np.int32), middles)
    away = 0.045 * np.ptp(building.vertices[:, :2], axis=0).max()
    return np.column_stack([middles + away * outward, z]), [e.name if is_open else f"{e.name} (closed)" for e in exits]
