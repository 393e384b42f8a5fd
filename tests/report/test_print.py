"""The report on paper: its pages are full, and the case can be copied from it."""

import base64
import io
import os
import re
import subprocess
import sys
import tomllib

import numpy as np
import pytest
from PIL import Image

from evac.pictures import writing
from evac.report.of_run import run_report
from evac.results.reading import read_results
from tests.replay.browser import find_chromium
from tests.report.letters import noted_letters

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="Chromium is looked for by its name on Unix")


@pytest.fixture(scope="module")
def page(finished):
    return run_report(finished)


@pytest.fixture(scope="module", params=[pytest.param("fonts of the machine", marks=pytest.mark.slow), "no fonts"])
def printed(request, page, tmp_path_factory):
    """The pages of a report, printed by Chromium."""
    pdf = pytest.importorskip("pypdfium2")
    if find_chromium() is None:
        pytest.skip("no Chromium is installed (Debian: apt-get install chromium)")
    folder = tmp_path_factory.mktemp("printed")
    (folder / "report.html").write_text(page, encoding="utf-8")
    (folder / "fonts.conf").write_text(f"<fontconfig><cachedir>{folder}</cachedir></fontconfig>", encoding="utf-8")
    fonts = {"FONTCONFIG_FILE": str(folder / "fonts.conf")} if request.param == "no fonts" else {}
    options = ["--headless=new", "--no-sandbox", "--no-pdf-header-footer", f"--user-data-dir={folder / 'profile'}"]
    target = f"--print-to-pdf={folder / 'report.pdf'}"
    address = (folder / "report.html").as_uri()
    words, environment = [find_chromium(), *options, target, address], {**os.environ, **fonts}
    subprocess.run(words, env=environment, check=True, capture_output=True, timeout=120)
    return list(pdf.PdfDocument(folder / "report.pdf"))


def test_letters_of_figures_have_six_points_at_least(finished, monkeypatch):
    sizes, font = [], writing.font
    monkeypatch.setattr(writing, "font", lambda size, is_bold=False: sizes.append(size) or font(size, is_bold))
    with noted_letters() as letters:
        page = run_report(finished)
    assert len(letters) >= 9  # plans, egress, bottleneck and six maps
    assert min(letters) >= 6.0
    pictures = re.findall(
        r'<figure class="(?:cover|course)"><img src="data:image/png;base64,([^"]*)".*?: ([0-9.]+)in', page
    )
    assert len(pictures) == 5
    for data, inches in pictures:
        pixels = Image.open(io.BytesIO(base64.b64decode(data))).width
        assert 72.0 * min(sizes) * float(inches) / pixels >= 6.0


def test_pictures_are_printed_at_the_size_for_which_they_are_drawn(printed, page):
    wanted = [72.0 * float(inches) for inches in re.findall(r'style="width: ([0-9.]+)in"', page)]
    images = [one for page in printed for one in page.get_objects(filter=[3])]
    found = [right - left for left, _, right, _ in (image.get_bounds() for image in images)]
    assert len(wanted) > 10
    for width in wanted:
        assert any(abs(one - width) < 1.0 for one in found)


def text_of(page):
    return page.get_textpage().get_text_range().replace("\r\n", "\n")


def test_no_page_is_less_than_half_full(printed):
    filled = []
    for page in printed:
        image = np.asarray(page.render(scale=0.5).to_pil().convert("L")) < 225
        top, bottom = (round(image.shape[0] * edge / 297) for edge in (17, 279))  # without the number of the page
        filled.append(np.flatnonzero(image[top:bottom].any(axis=1)).max() / (bottom - top))
    assert len(printed) <= 25
    assert min(filled) >= 0.5


def test_the_body_has_ten_pages_at_most(printed):
    (annex,) = [k for k, page in enumerate(printed) if re.search("^Appendix A: ", text_of(page), re.MULTILINE)]
    assert annex < 10


def test_the_case_copied_from_the_paper_is_the_case(printed, finished):
    text = "\n".join(map(text_of, printed))
    _, _, rest = text.partition("attached to this page: case.toml.\n")
    case = re.split("^Appendix [A-Z]: ", rest, maxsplit=1, flags=re.MULTILINE)[0]
    assert tomllib.loads(case) == read_results(finished).settings
