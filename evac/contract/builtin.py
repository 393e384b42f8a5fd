"""The built-in plugins, which the core knows by these names only, and which of them it uses where none is named."""

#: Modules of the built-in importers, sufficient to read a building without a case.
BUILTIN_IMPORTERS = tuple(
    f"evac_plugins.import_{name}"
    for name in ("dxf", "fds", "geojson", "ifc", "meshio", "obj", "off", "plan", "ply", "wkt")
)

#: Modules of the built-in exporters, sufficient to export a recorded run.
BUILTIN_EXPORTERS = tuple(f"evac_plugins.export_{name}" for name in ("csv", "geojson", "jupedsim", "parquet", "vtk"))

#: Modules of all built-in plugins; loaded by `Registry`, never imported by the core.
BUILTIN_PLUGINS = (
    *(f"evac_plugins.contact_{name}" for name in ("dem", "nsm1", "nsm2")),
    *(f"evac_plugins.solver_{name}" for name in ("sweeps", "gradient", "conjugate")),
    "evac_plugins.force_social",
    *(f"evac_plugins.behaviour_{name}" for name in ("response_time", "teacher_following", "route_choice")),
    *(
        f"evac_plugins.behaviour_{name}"
        for name in ("headway", "walking", "rest", "together", "familiarity", "helpers")
    ),
    *(f"evac_plugins.conditions_{name}" for name in ("prescribed", "fds")),
    "evac_plugins.smoke_laws",
    *(f"evac_plugins.recorder_{name}" for name in ("trajectory", "replay")),
    *BUILTIN_IMPORTERS,
    *BUILTIN_EXPORTERS,
    "evac_plugins.cases",
)

#: The behaviour with which people keep distances in the cases that evac writes, and which the output of a run names.
DEFAULT_MOVEMENT = "walking"

#: The source of conditions for which `evac conditions deck` prints lines.
DEFAULT_FIRE = "fds"

#: Solvers of the contact problem: that of models, and that of solves in which another solver fails.
DEFAULT_SOLVER, DEFAULT_STRONGER_SOLVER = "accelerated_sweeps", "conjugate_faces"
