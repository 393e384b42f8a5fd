"""The replay: a run as a single self-contained HTML page.

The recorder `replay` passes every recorded state to `motion.py`, which compresses it at once. `writer.py` puts `page/`,
the building, the motion, and the information about the run in one file; `evac replay` does the same from a trajectory.
Speeds, waiting and forces are computed here; the page computes densities and maps from them, on the same grid. In
`page/run/` is the run without the screen, `page/main.js` holds the state of the page, and the other scripts show it.
"""
