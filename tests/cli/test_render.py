"""evac render, evac export."""

import imageio.v2 as imageio
import numpy as np
import pytest


def test_draws_picture_and_film(evac, result, tmp_path):
    assert evac("render", result, "--out", "p.png", "f.gif", "--time", 2, "--speed", 40, "--colour-by", "speed") == 0
    picture = imageio.imread(tmp_path / "p.png")
    assert picture.std() > 5.0
    frames = imageio.mimread(tmp_path / "f.gif")
    assert len(frames) > 1
    assert not np.array_equal(frames[0], frames[-1])


@pytest.mark.parametrize("words", [["--out", "p.bmp"], ["--out", "f.gif", "--fps", "0"]])
def test_refuses_what_cannot_be_drawn(evac, result, words, capsys):
    assert evac("render", result, *words) == 2
    assert "Traceback" not in capsys.readouterr().err


def test_exports_to_another_folder(evac, result, tmp_path):
    assert evac("export", result, "--vtk", "--out", "vtk") == 0
    for name in ("animation.pvd", "building.vtp", "frames/frame_00000.vtp"):
        assert (tmp_path / "vtk" / name).read_bytes() == (result / name).read_bytes()
