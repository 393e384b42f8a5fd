import numpy as np
import pytest
from PIL import Image

from evac.errors import ResultError
from evac.output.pictures import draw_egress


def test_picture_shows_the_curve_of_everybody(results, tmp_path):
    draw_egress(results, tmp_path / "egress.png")
    pixels = np.asarray(Image.open(tmp_path / "egress.png").convert("RGB")).astype(int)
    assert pixels.shape == (750, 1200, 3)
    dark = (np.abs(pixels - [0x1F, 0x29, 0x33]) < 12).all(axis=2)
    rows, columns = np.nonzero(dark)
    assert dark.sum() > 1000
    assert np.ptp(columns) > 600  # from zero to the end of the run
    assert np.ptp(rows) > 150  # and from nobody to two of five


def test_each_group_has_its_own_curve(results, tmp_path, monkeypatch):
    drawn = []
    monkeypatch.setattr("evac.output.pictures.save", lambda figure, path: drawn.append(figure))
    draw_egress(results, tmp_path / "egress.png")
    (axes,) = drawn[0].axes
    curves = {line.get_label(): [list(values) for values in line.get_data()] for line in axes.get_lines()[1:]}
    assert curves == {
        "low": [[0.0, 4.0, 9.0, 20.0], [0, 1, 2, 2]],
        "high": [[0.0, 20.0], [0, 0]],
        "everybody": [[0.0, 4.0, 9.0, 20.0], [0, 1, 2, 2]],
    }


def test_unwritable_place_is_named(results, tmp_path):
    with pytest.raises(ResultError, match="absent"):
        draw_egress(results, tmp_path / "absent" / "egress.png")
