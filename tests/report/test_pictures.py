"""Pictures stand the right way up, show the right colours, and survive being embedded."""

import base64
from io import BytesIO

import numpy as np
import pytest
import torch
from PIL import Image

from svbrdfgan.io.image import srgb_from_linear
from svbrdfgan.report.pictures import data_uri, framed, heat, over_checker, signed_as_color, to_pillow, upright
from svbrdfgan.types import Layer


def decoded(uri: str) -> np.ndarray:
    head, data = uri.split(",", 1)
    assert head == "data:image/png;base64"
    return np.asarray(Image.open(BytesIO(base64.b64decode(data))))


def test_an_embedded_picture_keeps_its_pixels() -> None:
    codes = torch.randint(0, 256, (5, 7, 3))
    assert (decoded(data_uri(codes / 255, least=1)) == codes.numpy()).all()


def test_small_pictures_grow_by_a_whole_factor_and_large_ones_do_not() -> None:
    assert to_pillow(torch.zeros(32, 64, 3)).size == (256, 128)
    assert to_pillow(torch.zeros(100, 100, 3)).size == (300, 300)
    assert to_pillow(torch.zeros(200, 300, 3)).size == (300, 200)


def test_v_points_up_and_what_is_not_shown_is_transparent() -> None:
    texture, shown = torch.zeros(4, 4, 3), torch.zeros(4, 4, dtype=torch.bool)
    texture[0, 1], shown[0, 1] = 1.0, True
    picture = upright(texture, shown)
    assert picture[3, 1].tolist() == [1, 1, 1, 1]
    assert picture[..., 3].sum() == 1


def test_directions_have_their_usual_colours() -> None:
    up = torch.tensor([0.0, 1.0, 0.0]).reshape(3, 1, 1)
    assert signed_as_color(up)[0, 0].tolist() == [0.5, 1.0, 0.5]


def test_a_layer_hides_the_checker_as_its_alpha_says() -> None:
    layer = Layer(torch.tensor([0.3, 0.2, 0.1, 1.0]).expand(32, 32, 4).clone())
    torch.testing.assert_close(over_checker(layer)[5, 5], srgb_from_linear(layer.base_color[0, 0]))
    layer.alpha[:] = 0
    assert len(over_checker(layer)[..., 0].unique()) == 2


def test_more_heat_is_brighter() -> None:
    ramp = heat(torch.linspace(0, 2, 9).unsqueeze(0), top=1.0).sum(dim=-1)[0]
    assert (ramp[:5].diff() > 0).all()
    assert (ramp[4:] == ramp[4]).all()


@pytest.mark.parametrize("box", [(4, 8, 10, 30), (0, 32, 0, 40), (0, 30, 5, 9), (31, 32, 39, 40)])
def test_a_frame_holds_all_that_is_covered(box: tuple[int, int, int, int]) -> None:
    top, bottom, left, right = box
    coverage, picture = torch.zeros(32, 40), torch.full((32, 40, 3), 0.5)
    coverage[top:bottom, left:right] = 1.0
    picture[coverage > 0] = 0.9
    picture[0, 0] = 0.5
    cut = framed(picture, coverage, aspect=1.5)
    assert (cut == 0.9).sum() == (picture == 0.9).sum()
    assert cut.shape[1] == round(1.5 * cut.shape[0])


def test_a_frame_around_nothing_is_the_picture() -> None:
    picture = torch.rand(8, 8, 3)
    assert framed(picture, torch.zeros(8, 8)) is picture
