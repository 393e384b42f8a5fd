"""Mobility: people in wheelchairs, on crutches and others, on the flat, on ramps and through doors."""
