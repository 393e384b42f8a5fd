"""Colours by which groups are told apart with any kind of colour vision."""

from itertools import combinations

import numpy as np
import pytest

from evac.pictures.palette import GROUPS, NO_GROUP, group_looks, rgb

#: Linear RGB as seen without one kind of cones (Machado, Oliveira, Fernandes 2009, severity 1).
VISION = {
    "all cones": np.eye(3),
    "protanopia": [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]],
    "deuteranopia": [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.01182, 0.04294, 0.968881]],
    "tritanopia": [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.3039]],
}
TO_XYZ = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])

#: Distance in CIELAB: 2.3 is just noticed side by side; this is told apart from memory.
TOLD_APART = 12.0


def seen(colours, vision):
    """Return colours in CIELAB as they are seen."""
    share = np.array(rgb(colours)) / 255.0
    linear = np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)
    xyz = np.clip(linear @ np.array(vision).T, 0.0, 1.0) @ TO_XYZ.T / [0.9505, 1.0, 1.089]
    root = np.where(xyz > 0.008856, np.cbrt(xyz), 7.787 * xyz + 16.0 / 116.0)
    return np.column_stack([116 * root[:, 1] - 16, 500 * (root[:, 0] - root[:, 1]), 200 * (root[:, 1] - root[:, 2])])


@pytest.mark.parametrize("vision", VISION)
def test_60_groups_are_told_apart_by_body_head_or_belt(vision):
    looks = group_looks(60)
    colours = sorted({colour for look in looks for colour in look})
    place = dict(zip(colours, seen(colours, VISION[vision]), strict=True))
    apart = [
        max(np.linalg.norm(place[a] - place[b]) for a, b in zip(one, other, strict=True))
        for one, other in combinations(looks, 2)
    ]
    assert min(apart) >= TOLD_APART
    assert looks[:8] == [(colour, colour, colour) for colour in GROUPS]
    assert looks[-1] == (NO_GROUP,) * 3
