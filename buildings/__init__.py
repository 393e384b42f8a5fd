"""The cases that evac ships: one folder each, with case.toml, mesh and README."""
