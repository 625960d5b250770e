"""Arguments of `shade` that fit no renderer, and the messages; for other methods see `test_checked_renderer`."""

import re

import pytest
import torch

from svbrdfgan.errors import ConfigError, UnsupportedError
from svbrdfgan.protocols import RendererCapabilities
from svbrdfgan.rendering import validation

ABLE = RendererCapabilities(maps=frozenset({"base_color", "roughness", "metallic"}), deferred=True)
VIEW = (4, 6), 2


@pytest.mark.parametrize(
    ("views", "shape", "maps", "visit", "message"),
    [
        ([], (0, 1, 1, 3), ("base_color",), 0, "shade got no stored light; wanted that of one view or more"),
        ([VIEW, ((4, 5), 2)], (4, 1, 1, 3), ("base_color",), 0, "views of 4 x 5, 4 x 6 pixels (height x width)"),
        ([VIEW], (2, 1, 1, 3), ("base_color",), -1, "visit is -1; wanted 0 or more"),
        ([VIEW], (2, 1, 1, 6), ("base_color", "normal"), 0, "maps names normal, but the renderer reads only"),
        ([VIEW], (2, 1, 1, 0), (), 0, "maps is empty; wanted base_color, then each further map once"),
        ([VIEW], (2, 1, 1, 4), ("roughness", "base_color"), 0, "maps is roughness, base_color; wanted base_color"),
        ([VIEW], (2, 1, 1, 4), ("base_color", "metallic"), 0, "metallic without roughness; wanted both or neither"),
        ([VIEW], (1, 8, 8, 3), ("base_color",), 0, "shape (1, 8, 8, 3); wanted (2, rows, cols, 3): one for each"),
        ([VIEW], (2, 8, 8, 3), ("base_color", "roughness"), 0, "wanted (2, rows, cols, 4): one for each learnable"),
    ],
)
def test_what_is_shaded_fits_the_views(
    views: list[tuple[tuple[int, int], int]], shape: tuple[int, ...], maps: tuple[str, ...], visit: int, message: str
) -> None:
    with pytest.raises((ConfigError, UnsupportedError), match=re.escape(message)):
        validation.check_shade("mine", ABLE, views, torch.zeros(shape), maps, visit=visit)
    validation.check_shade("mine", ABLE, [VIEW], torch.zeros(2, 8, 8, 4), ("base_color", "roughness"), visit=0)
