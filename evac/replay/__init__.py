"""The replay: a run as a single self-contained HTML page.

`writer.py` passes every recorded state of a trajectory to `motion.py`, which compresses it, and puts `page/`, the
building, the motion, and the information about the run in one file, when the run has ended and for `evac replay`.
Speeds, waiting and forces are computed here; the page computes densities and maps from them, on the same grid. In
`page/run/` is the run without the screen, `page/main.js` holds the state of the page, and the other scripts show it.
"""
