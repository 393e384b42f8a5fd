"""Quantities computed from a trajectory: maps, congestion, passages of lines, flows, occupancy."""
