from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image

from evac.pictures.pictures import egress_figure
from evac.pictures.writing import save


def test_picture_shows_the_curve_of_everybody(results, tmp_path):
    save(egress_figure(results), tmp_path / "egress.png")
    pixels = np.asarray(Image.open(tmp_path / "egress.png").convert("RGB")).astype(int)
    assert pixels.shape == (750, 1200, 3)
    dark = (np.abs(pixels - [0x1F, 0x29, 0x33]) < 12).all(axis=2)
    rows, columns = np.nonzero(dark)
    assert dark.sum() > 1000
    assert np.ptp(columns) > 600  # from zero to the end of the run
    assert np.ptp(rows) > 150  # and from nobody to two of five


def test_each_group_has_its_own_curve(results):
    (axes,) = egress_figure(results).axes
    curves = {line.get_label(): [list(values) for values in line.get_data()] for line in axes.get_lines()[1:]}
    assert curves == {
        "low": [[0.0, 4.0, 9.0, 20.0], [0, 1, 2, 2]],
        "high": [[0.0, 20.0], [0, 0]],
        "everybody": [[0.0, 4.0, 9.0, 20.0], [0, 1, 2, 2]],
    }


@pytest.mark.parametrize(("people", "words", "groups"), [(5, 1, 1), (136, 12, 2), (5, 60, 12), (99_999, 60, 12)])
def test_all_that_is_written_has_room(results, people, words, groups):
    rows = np.array([0, 1])
    many = replace(
        results,
        crowd=SimpleNamespace(
            exit_time=np.linspace(1.0, 9.0, people), arrival_time=np.zeros(people), level=np.full(people, -1)
        ),
        groups=[SimpleNamespace(name=f"group {k} with a name", rows=rows) for k in range(groups)],
        title="evacuation " * words,
    )
    figure = egress_figure(many)
    inner = figure.get_tightbbox()
    assert inner.x0 > 0.0
    assert inner.y0 > 0.0
    assert inner.x1 < figure.get_figwidth()
    assert inner.y1 < figure.get_figheight()
    assert np.ptp(figure.axes[0].get_position(), axis=0).min() > 0.5
