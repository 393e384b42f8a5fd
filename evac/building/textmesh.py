"""Readers of the two plain text formats OBJ and OFF: vertices and polygons, nothing else."""

import re
from collections import defaultdict
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IndexArray = NDArray[np.int64]


def read_obj(path: Path) -> tuple[FloatArray, list[IndexArray]]:
    """Read the ``v`` and ``f`` lines of a Wavefront OBJ file.

    Texture and normal indices (``f 1/2/3``) and every other line are passed over; negative indices
    count from the last vertex read.

    Returns
    -------
    points : (v, 3) float64
    blocks : list of (n, k) int64
        Faces with k corners.

    Raises
    ------
    ValueError
        If a line cannot be read; names its number.
    """
    points: list[list[float]] = []
    faces: list[list[int]] = []
    text = path.read_text(encoding="utf-8-sig", errors="replace").replace("\\\n", " ")
    if "\0" in text:
        raise ValueError("the text is not UTF-8; save it as UTF-8")
    for number, line in enumerate(text.splitlines(), start=1):
        word, *rest = line.partition("#")[0].split() or [""]
        try:
            if word == "v":
                x, y, z = rest[:3]
                points.append([float(x), float(y), float(z)])
            elif word == "f":
                corners = [int(corner.partition("/")[0]) for corner in rest]
                if 0 in corners or min(corners, default=1) < -len(points):
                    raise ValueError("a face counts its vertices from 1, or backwards from -1, the last one above it")
                faces.append(_checked([c - 1 if c > 0 else len(points) + c for c in corners]))
        except ValueError as error:
            raise ValueError(f"line {number}: {line.strip()!r}: {error}") from error
    return np.array(points, dtype=np.float64).reshape(-1, 3), face_blocks(faces)


def read_off(path: Path) -> tuple[FloatArray, list[IndexArray]]:
    """Read an OFF file (also COFF, NOFF, STOFF: what follows x, y, z is passed over).

    Returns
    -------
    points : (v, 3) float64
    blocks : list of (n, k) int64

    Raises
    ------
    ValueError
        If the header, a count or a line is wrong.
    """
    text = path.read_text(encoding="utf-8-sig").splitlines()
    lines = [(number, line.partition("#")[0].split()) for number, line in enumerate(text, start=1)]
    lines = [(number, words) for number, words in lines if words]
    if not lines or not re.fullmatch(r"(ST)?C?N?OFF", lines[0][1][0]):
        raise ValueError("the first word must be OFF")
    number, first = lines[0]
    (_, counts), *rest = [(number, first[1:]), *lines[1:]] if len(first) > 1 else lines[1:] or [(number, [])]
    if len(counts) < 2:
        raise ValueError("the numbers of vertices and faces are missing")
    n_points, n_faces = int(counts[0]), int(counts[1])
    if len(rest) != n_points + n_faces:
        raise ValueError(f"{n_points} vertices and {n_faces} faces are announced, but {len(rest)} lines follow")
    points, faces = [], []
    for index, (number, words) in enumerate(rest):
        try:
            if index < n_points:
                x, y, z = words[:3]
                points.append([float(x), float(y), float(z)])
            else:
                corners = [int(corner) for corner in words[1 : 1 + int(words[0])]]
                if len(corners) != int(words[0]):
                    raise ValueError(f"{words[0]} corners are announced")
                faces.append(_checked(corners))
        except ValueError as error:
            raise ValueError(f"line {number}: {text[number - 1].strip()!r}: {error}") from error
    return np.array(points, dtype=np.float64).reshape(-1, 3), face_blocks(faces)


def _checked(face: list[int]) -> list[int]:
    """Return the face, or refuse one that encloses nothing."""
    if len(face) < 3:
        raise ValueError(f"a face has only {len(face)} corners")
    return face


def face_blocks(faces: list[list[int]]) -> list[IndexArray]:
    """Gather faces of equal length, in the order of their lengths."""
    by_length: dict[int, list[list[int]]] = defaultdict(list)
    for face in faces:
        by_length[len(_checked(face))].append(face)
    return [np.array(by_length[length], dtype=np.int64) for length in sorted(by_length)]
