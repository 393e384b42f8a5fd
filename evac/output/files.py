"""The files of a result folder: what each is called, and what is said where one cannot be written."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from evac.errors import ResultError

TRAJECTORY_NAME = "trajectory.evac"
SUMMARY_NAME = "summary.json"
EGRESS_NAME = "egress.csv"
EGRESS_PICTURE_NAME = "egress.png"
PEOPLE_NAME = "people.csv"
RUNS_NAME = "runs.csv"
RUNS_STREAM_NAME = "runs.arrows"
RUNS_PARQUET_NAME = "runs.parquet"
STATISTICS_NAME = "statistics.csv"
CONVERGENCE_NAME = "convergence.csv"
SWEEP_PICTURE_NAME = "statistics.png"
STUDY_NAME = "study.json"
ANIMATION_NAME = "animation.pvd"
BUILDING_NAME = "building.vtp"
FRAMES_FOLDER = "frames"

#: Pattern of the files of single frames, see `frame_name`.
FRAMES = f"{FRAMES_FOLDER}/frame_*.vtp"

#: What `evac render` draws if nothing else is named.
PICTURE_NAME = "picture.png"
FILM_NAME = "film.gif"

#: What a run writes to its folder; nothing else there is ever touched.
WRITTEN = (
    EGRESS_NAME,
    EGRESS_PICTURE_NAME,
    PEOPLE_NAME,
    RUNS_NAME,
    RUNS_STREAM_NAME,
    RUNS_PARQUET_NAME,
    "runs.new",
    STATISTICS_NAME,
    CONVERGENCE_NAME,
    SWEEP_PICTURE_NAME,
    ANIMATION_NAME,
    BUILDING_NAME,
    FRAMES,
    PICTURE_NAME,
    FILM_NAME,
    SUMMARY_NAME,  # these three last: while one is there, the folder is known to be evac's
    STUDY_NAME,
    TRAJECTORY_NAME,
)


def frame_name(k: int) -> str:
    """Return the file of frame `k` of the VTK animation, relative to the result folder."""
    return FRAMES.replace("*", f"{k:05d}")


@contextmanager
def writing(what: str, place: Path) -> Iterator[None]:
    """Say what cannot be written, and where, if the system refuses.

    Parameters
    ----------
    what : str
        Such as ``"the results"``.
    place : Path
        File or folder.

    Raises
    ------
    ResultError
        In place of any OSError.
    """
    try:
        yield
    except OSError as error:
        raise ResultError(f"{place}: cannot write {what}: {error}; mend that or write somewhere else") from error
