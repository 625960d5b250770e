"""Random numbers, and their independence of seeds, pixels and chunks."""

import torch
from svbrdfgan_numpy import NumpyRenderer
from torch import Tensor

from svbrdfgan.testing import scenes


def _plane(spp: int, seed: int) -> Tensor:
    """A picture in which every pixel has the same expected value."""
    view = scenes.front_view(scenes.random_light(), vertical_fov=0.2)
    return scenes.picture(NumpyRenderer(), scenes.plane(), scenes.lambertian((1.0, 1.0, 1.0)), view, spp, seed).image


def test_the_same_seed_gives_the_same_picture_however_it_is_cut() -> None:
    view = scenes.corner_view(scenes.random_light(), width=5, height=4)
    materials = scenes.lambertian(scenes.random_texture(4, 4), scenes.RED, scenes.GREEN)
    images = [
        scenes.picture(NumpyRenderer(3, chunk), scenes.corner_box(), materials, view, spp=3, seed=8).image
        for chunk in (100_000, 100_000, 100, 1)
    ]
    assert all(torch.equal(images[0], image) for image in images[1:])


def test_other_seeds_are_independent() -> None:
    pictures = torch.stack([_plane(4, seed).flatten() for seed in (0, 1, 2, 3)])
    correlation = torch.corrcoef(pictures - pictures.mean(dim=1, keepdim=True))
    assert (correlation - torch.eye(4)).abs().max() < 0.2  # 768 values: standard deviation 0.06 (channels are alike)


def test_pixels_are_independent() -> None:
    picture = _plane(4, 0).mean(dim=-1)
    pairs = torch.corrcoef(torch.stack([picture[:, :-1].flatten(), picture[:, 1:].flatten()]))
    assert abs(float(pairs[0, 1])) < 0.26  # 240 values: 4 standard deviations


def test_the_error_falls_as_the_root_of_the_samples() -> None:
    ratio = _plane(4, 5).std(dim=(0, 1)) / _plane(64, 6).std(dim=(0, 1))
    assert torch.allclose(ratio, torch.full((3,), 4.0), rtol=0.25)  # 256 pixels: standard deviation 6 %
