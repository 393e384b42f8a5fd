"""Plane geometry of polygons."""
