import time

import numpy as np
import pytest

from fabcraft.errors import InputError
from fabcraft.guidance.edges import understand
from fabcraft.read.image_file import read_image

HEAD = (
    '<svg xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink" viewBox="0 0 200 100"'
)


def svg(tmp_path, inner, head=HEAD, before=""):
    path = tmp_path / "a.svg"
    path.write_text(f"{before}{head}>{inner}</svg>")
    return path


def drawn(tmp_path, inner, **how):
    """(H, W) True where something opaque was drawn."""
    return read_image(svg(tmp_path, inner, **how))[..., 3] > 127


SHAPES = {
    "path": '<path d="M50 10 H150 V90 H50 Z"/>',
    "rect": '<rect x="50" y="10" width="100" height="80"/>',
    "polygon": '<polygon points="50,10 150,10 150,90 50,90"/>',
    "polyline": '<polyline points="50,10 150,10 150,90 50,90"/>',
    "line": '<line x1="50" y1="50" x2="150" y2="50" stroke="#000" stroke-width="80"/>',
    "transforms": '<g transform="translate(100 50)"><rect transform="rotate(90) scale(2)" x="-20" y="-25" '
    'width="40" height="50"/></g>',
    "use": '<defs><rect id="r" width="100" height="80"/></defs><use xlink:href="#r" x="50" y="10"/>',
    "style sheet": '<style>.a{fill:none;stroke:red;stroke-width:80}</style><path class="a" d="M50 50 H150"/>',
    "no namespace": '<rect x="50" y="10" width="100" height="80"/>',
}


@pytest.mark.parametrize("shape", SHAPES)
def test_every_shape_covers_its_own_area(tmp_path, shape):
    head = HEAD.replace('xmlns="http://www.w3.org/2000/svg" ', "") if shape == "no namespace" else HEAD
    mask = drawn(tmp_path, SHAPES[shape], head=head)
    assert mask.shape == (600, 1200)
    rows, columns = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
    assert [rows[0], rows[-1] + 1, columns[0], columns[-1] + 1] == pytest.approx([60, 540, 300, 900], abs=1)
    assert mask.sum() == pytest.approx(600 * 480, rel=0.01)


def test_circles_ellipses_and_arcs_have_their_areas(tmp_path):
    assert drawn(tmp_path, '<circle cx="100" cy="50" r="40"/>').sum() == pytest.approx(
        np.pi * 240**2, rel=0.01
    )
    ellipse = drawn(tmp_path, '<ellipse cx="100" cy="50" rx="80" ry="40"/>')
    assert ellipse.sum() == pytest.approx(np.pi * 480 * 240, rel=0.01)
    arc = drawn(tmp_path, '<path d="M60 50 A40 40 0 1 1 140 50 A40 40 0 1 1 60 50Z"/>')
    assert arc.sum() == pytest.approx(np.pi * 240**2, rel=0.01)


def test_a_line_drawing_in_svg_is_understood(tmp_path):
    eyes = "".join(f'<ellipse cx="{x}" cy="52" rx="9" ry="6"/>' for x in (80, 120))
    inner = f'<g fill="none" stroke="#222" stroke-width="2"><circle cx="100" cy="50" r="44"/>{eyes}</g>'
    drawing = understand(read_image(svg(tmp_path, inner)))
    assert drawing.silhouette.sum() == pytest.approx(np.pi * (45 * 6) ** 2, rel=0.01)
    assert len(drawing.eyes) == 2


def test_units_and_an_absent_view_box_give_the_shape_of_the_page(tmp_path):
    head = '<svg xmlns="http://www.w3.org/2000/svg" width="2in" height="96px"'
    mask = drawn(tmp_path, '<rect width="96" height="96"/>', head=head)
    assert mask.shape == (600, 1200)
    assert mask[:, :598].all()
    assert not mask[:, 602:].any()


def test_what_an_editor_adds_is_passed_over(tmp_path):
    before = '<?xml version="1.0"?><!DOCTYPE svg PUBLIC "-//W3C//DTD SVG 1.1//EN" "http://www.w3.org/Graphics/SVG/1.1/DTD/svg11.dtd">'
    inner = '<metadata>x</metadata><sodipodi:namedview xmlns:sodipodi="http://sodipodi"/>' + SHAPES["rect"]
    assert drawn(tmp_path, inner, before=before).any()


ENTITY = '<!DOCTYPE svg [<!ENTITY a SYSTEM "file:///etc/hostname">]>'
LAUGHS = '<!DOCTYPE svg [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;&a;&a;">]>'
DOUBLING = "<defs><g id='a0'><path d='M0 0H9'/></g>" + "".join(
    f"<g id='a{k}'><use href='#a{k - 1}'/><use href='#a{k - 1}'/></g>" for k in range(1, 30)
) + "</defs><use href='#a29'/>"  # fmt: skip
HOSTILE = {
    "an entity of a file": ("", ENTITY, "entities"),
    "entities that multiply": ("", LAUGHS, "entities"),
    "uses that multiply": (DOUBLING, "", "unfolds into more than"),
    "a use of itself": ("<g id='a'><use href='#a'/></g>", "", "points at itself"),
    "a script": ("<script>1</script>", "", "holds a <script>"),
    "words": ("<text>cat</text>", "", "holds a <text>"),
    "a picture": ("<image href='a.png'/>", "", "holds a <image>"),
    "an address": ("<use href='http://x.org/a.svg#b'/>", "", "outside itself"),
    "a style's address": ("<style>@import 'http://x.org/a.css';</style>", "", "refers to a file or address"),
    "a fill's address": ("<rect width='9' height='9' fill='url(http://x.org/a)'/>", "", "refers to a file"),
    "a filter": ("<filter id='f'/>", "", "holds a <filter>"),
    "a deep nest": ("<g>" * 99 + "</g>" * 99, "", "levels of groups"),
    "a missing end": ("<g>", "", "damaged"),
}


@pytest.mark.parametrize("what", HOSTILE)
def test_what_could_do_harm_is_refused_at_once(tmp_path, what):
    inner, before, says = HOSTILE[what]
    start = time.perf_counter()
    with pytest.raises(InputError, match=says) as error:
        read_image(svg(tmp_path, inner, before=before))
    assert time.perf_counter() - start < 2.0
    assert error.value.next_step.endswith(".")


@pytest.mark.parametrize(
    "size", ['width="1" height="1e8"', 'width="100%"', 'viewBox="0 0 0 0"', 'viewBox="0 0 nan 5"']
)
def test_a_page_without_a_sensible_size_is_refused(tmp_path, size):
    with pytest.raises(InputError, match=r"far from a drawing|says neither"):
        read_image(svg(tmp_path, SHAPES["rect"], head=f'<svg xmlns="http://www.w3.org/2000/svg" {size}'))
