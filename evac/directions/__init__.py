"""Travel times and directions by fast marching: see `evac.directions.build.build_fields`."""
