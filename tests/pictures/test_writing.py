import pytest
from matplotlib.figure import Figure
from PIL import Image

from evac.pictures.writing import legible, save


@pytest.mark.parametrize(
    ("text", "shown", "names"),
    [
        ("exit 'north' 1.20 m, Łódź, Αθήνα, Выход", "exit 'north' 1.20 m, Łódź, Αθήνα, Выход", []),
        ("level '1階' at (2.72, 1.40)", "level '[1]' at (2.72, 1.40)", ["1階"]),
        ("東口 1.20 m\n西口, 東口", "[1] 1.20 m\n[2], [1]", ["東口", "西口"]),
    ],
)
def test_words_that_the_font_lacks_are_numbers(text, shown, names):
    found = []
    assert legible(text, found) == shown
    assert found == names


def test_a_picture_has_the_list_of_its_numbers_beside_it(tmp_path):
    figures = [Figure((2.0, 1.0)) for _ in range(2)]
    for figure, words in zip(figures, ("東口: 階段", "[1]: [2]"), strict=True):
        figure.text(0.1, 0.5, words)
    pictures = [tmp_path / "names.png", tmp_path / "numbers.png"]
    for figure, path in zip(figures, pictures, strict=True):
        save(figure, path)  # without a warning about glyphs, which would be an error here
    assert (tmp_path / "names.png.txt").read_text(encoding="utf-8") == "[1] 東口\n[2] 階段\n"
    assert not (tmp_path / "numbers.png.txt").exists()
    one, other = (Image.open(path).tobytes() for path in pictures)
    assert one == other
    assert figures[0].texts[0].get_text() == "東口: 階段"
