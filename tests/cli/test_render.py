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


def test_draws_maps(evac, result, tmp_path, capsys):
    assert evac("map", result, "--of", "density,usage", "--spacing", 0.5, "--out", "maps") == 0
    assert capsys.readouterr().out.split() == ["maps/map_density.png", "maps/map_usage.png"]
    assert imageio.imread(tmp_path / "maps/map_usage.png").std() > 5.0


@pytest.mark.parametrize(("name", "file"), [("geojson", "building.geojson"), ("csv", "trajectory.csv")])
def test_exports_go_to_a_folder_of_the_result(evac, result, tmp_path, capsys, name, file):
    copy = tmp_path / "copy"
    copy.mkdir()
    (copy / "trajectory.evac").write_bytes((result / "trajectory.evac").read_bytes())
    assert evac("export", copy, "--to", name) == 0
    assert capsys.readouterr().out.strip() == str(copy / "export" / file)
    assert (copy / "export" / file).stat().st_size > 0
