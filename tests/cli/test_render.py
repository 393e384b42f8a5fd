"""evac render, evac map, evac export."""

import imageio.v2 as imageio
import numpy as np
import pytest


def test_draws_picture_and_film(evac, result, tmp_path):
    words = ["--out", "p.png", "f.gif", "--time", 2, "--speed", 40, "--colour-by", "speed", "--size", 320, 240]
    assert evac("render", result, *words) == 0
    picture = imageio.imread(tmp_path / "p.png")
    assert picture.std() > 5.0
    frames = imageio.mimread(tmp_path / "f.gif")
    assert len(frames) > 1
    assert not np.array_equal(frames[0], frames[-1])


@pytest.mark.parametrize("words", [["--out", "p.bmp"], ["--out", "f.gif", "--fps", "0"]])
def test_refuses_what_cannot_be_drawn(evac, result, words, capsys):
    assert evac("render", result, *words) == 2
    assert "Traceback" not in capsys.readouterr().err


def test_draws_maps(evac, result, tmp_path, capsys):
    assert evac("map", result, "--of", "density,usage", "--spacing", 0.5, "--out", "maps") == 0
    assert capsys.readouterr().out.split() == ["maps/map_density.png", "maps/map_usage.png"]
    assert imageio.imread(tmp_path / "maps/map_usage.png").std() > 5.0


@pytest.mark.parametrize("words", [["--of", "mood"], ["--out", "one.png"], ["--level", "cellar"], ["--from", "999"]])
def test_refuses_maps_that_cannot_be_drawn(evac, result, words, capsys):
    assert evac("map", result, *words) == 2
    assert words[1] in capsys.readouterr().err


def test_exports_to_another_folder(evac, result, tmp_path):
    assert evac("export", result, "--out", "vtk") == 0
    for name in ("animation.pvd", "building.vtm", "frames/frame_00000.vtp"):
        assert (tmp_path / "vtk" / name).read_bytes() == (result / name).read_bytes()


@pytest.mark.parametrize(("name", "file"), [("geojson", "building.geojson"), ("csv", "trajectory.csv")])
def test_exports_go_to_a_folder_of_the_result(evac, result, tmp_path, capsys, name, file):
    copy = tmp_path / "copy"
    copy.mkdir()
    (copy / "trajectory.evac").write_bytes((result / "trajectory.evac").read_bytes())
    assert evac("export", copy, "--to", name) == 0
    assert capsys.readouterr().out.strip() == str(copy / "export" / file)
    assert (copy / "export" / file).stat().st_size > 0


@pytest.mark.parametrize("words", [["--to", "pdf"], ["--to", "csv", "--set", "colour=1"]])
def test_refuses_formats_and_parameters_that_are_not_there(evac, result, words, capsys):
    assert evac("export", result, *words) == 2
    assert words[-1].partition("=")[0] in capsys.readouterr().err
