"""The estimated light of a picture: known light is recovered, weathered or not, and is never negative."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import torch
from numpy import ndarray
from scipy.optimize import nnls
from torch import Tensor

from svbrdfgan.data.photos.light import (
    LOBES,
    Evidence,
    environment,
    estimate_light,
    evidence_size,
    gather_evidence,
    lobes,
)
from svbrdfgan.errors import AssetError
from svbrdfgan.plugins.registry import load_embedding, load_renderer
from svbrdfgan.procedural.kinds import sample_vehicle
from svbrdfgan.procedural.sky import pixels
from svbrdfgan.procedural.vehicle import build_vehicle
from svbrdfgan.types import Camera, Environment, Material, Materials, Rendering, View

ROWS = 16
GREY = (0.18, 0.18, 0.18)
PAINT = np.array([0.42, 0.13, 0.03])


def gradient() -> Tensor:
    """Light that is bluish and brighter above."""
    up = torch.cos((torch.arange(ROWS) + 0.5) / ROWS * math.pi)[:, None, None]
    return (0.8 + up * torch.tensor([0.3, 0.4, 0.5])).expand(ROWS, 2 * ROWS, 3).contiguous()


@pytest.fixture(scope="module")
def normals() -> ndarray:
    """Of a surface as a camera at +Z and a little above sees it."""
    rng = np.random.default_rng(0)
    found = rng.normal(size=(4000, 3))
    found /= np.linalg.norm(found, axis=1, keepdims=True)
    return found[found @ [0, 0.3, 0.95] > 0.1][:900]


@pytest.fixture(scope="module")
def white(normals: ndarray) -> ndarray:
    """Radiance of white Lambertian surfaces of these normals under each lobe, by quadrature."""
    direction, solid_angle = pixels(ROWS, 2 * ROWS)
    cosine = np.maximum(np.einsum("nd,rwd->nrw", normals, direction), 0) * solid_angle[..., 0] / math.pi
    lit = gradient().numpy()[..., None] * lobes(ROWS, 2 * ROWS).permute(1, 2, 0).numpy()[:, :, None]
    return np.einsum("nrw,rwcl->ncl", cosine, lit)


@pytest.fixture(scope="module")
def weights() -> ndarray:
    """One lobe is a sun; there is less light from the left, and it is yellow."""
    around = 1 + 0.6 * np.sin(np.linspace(0, 12, LOBES))
    around[LOBES // 4] = 12.0
    return np.array([1.2, 1.0, 0.7])[:, None] * around


def shown(white: ndarray, weights: ndarray, color: ndarray) -> ndarray:
    """The picture, with the gloss of paint that is not matt."""
    return np.einsum("pcl,cl->pc", white, weights) * (color + 0.02)


def evidence_of(radiance: ndarray, base: ndarray, white: ndarray) -> Evidence:
    return Evidence(radiance, base, white, np.ones((1, len(white)), dtype=bool), np.empty((0, *base.shape)))


def error(white: ndarray, found: ndarray, weights: ndarray) -> float:
    """The median relative error of radiance that a white surface returns."""
    made, true = (np.einsum("pcl,cl->pc", white, one) for one in (found, weights))
    return float(np.median(np.abs(made / true - 1)))


def test_lobes_share_the_sphere_among_them() -> None:
    found = lobes(ROWS, 2 * ROWS)
    assert found.shape == (LOBES, ROWS, 2 * ROWS)
    assert torch.allclose(found.sum(dim=0), torch.ones(ROWS, 2 * ROWS), atol=1e-5)
    assert float(found.min()) >= 0
    direction, solid_angle = pixels(ROWS, 2 * ROWS)
    share = (found.numpy() * solid_angle[..., 0]).sum(axis=(1, 2)) / (4 * math.pi)
    assert share.min() > 0.5 / LOBES
    assert share.max() < 2.0 / LOBES
    # Lobe 0 is at the zenith, row 0; the columns of any other are where `docs/conventions.md` has its direction.
    assert int(found[0].sum(dim=1).argmax()) == 0
    centre = np.einsum("lrw,rwd->ld", found.numpy() * solid_angle[..., 0], direction)
    peak = direction.reshape(-1, 3)[found.flatten(1).argmax(dim=1).numpy()]
    assert ((centre / np.linalg.norm(centre, axis=1, keepdims=True) * peak).sum(axis=1) > 0.97).all()


def test_light_of_the_lobes_is_recovered(white: ndarray, weights: ndarray) -> None:
    base, grey = np.broadcast_to(PAINT, white.shape[:2]), np.broadcast_to(weights.mean(axis=0), weights.shape)
    neutral, yellow = (evidence_of(shown(white, light, PAINT), base, white) for light in (grey, weights))
    assert error(white, estimate_light([neutral], GREY).weights, grey) < 0.02
    assert error(white, estimate_light([yellow], GREY).weights, weights) < 0.08  # its colour is not trusted whole
    assert error(white, np.ones_like(weights), weights) > 0.2  # the error of the mean light


def test_weathering_of_a_third_is_not_taken_for_light(white: ndarray, weights: ndarray, normals: ndarray) -> None:
    """The sides' lowest, as of road dirt, in another colour than assumed; plain least squares takes it for light."""
    paint = np.array([0.03, 0.06, 0.30])
    third = normals[:, 1] < np.quantile(normals[:, 1], 1 / 3)
    share = third * np.random.default_rng(1).uniform(0.3, 1.0, len(normals))
    color = paint + share[:, None] * (np.array([0.26, 0.17, 0.10]) - paint)
    evidence = evidence_of(shown(white, weights, color), np.broadcast_to(paint, white.shape[:2]), white)
    plain = np.stack([nnls(white[:, c] * (paint[c] + 0.02), evidence.radiance[:, c])[0] for c in range(3)])
    assert error(white[third], plain, weights) > 0.5
    assert error(white[third], estimate_light([evidence], GREY).weights, weights) < 0.25
    assert error(white, estimate_light([evidence], GREY).weights, weights) < 0.22


def test_weathering_everywhere_is_not_taken_for_light_once_a_model_knows_it(white: ndarray, weights: ndarray) -> None:
    """Dust on all of dark paint, as no single picture tells from light: draws of about the right layer do."""
    paint, rng = np.array([0.04, 0.04, 0.05]), np.random.default_rng(4)

    def dusty() -> ndarray:
        return paint + rng.uniform(0.15, 0.45, (len(white), 1)) * (0.3 - paint)

    alone = evidence_of(shown(white, weights, dusty()), np.broadcast_to(paint, white.shape[:2]), white)
    told = replace(alone, draws=np.stack([dusty() for _ in range(8)]))
    assert error(white, estimate_light([alone], GREY).weights, weights) > 0.25
    assert error(white, estimate_light([told], GREY).weights, weights) < 0.1
    assert not estimate_light([told], GREY).shares.any()
    third = told.thinned(len(white) // 3)
    assert third.draws.shape == (8, len(third.radiance), 3)
    assert third.usable.sum() == len(third.radiance)


def test_light_is_never_negative_and_the_same_every_time(white: ndarray) -> None:
    """For any picture; here, noise."""
    noise = np.random.default_rng(2).exponential(size=white.shape[:2])
    evidence = evidence_of(noise, np.broadcast_to(PAINT, white.shape[:2]), white)
    found = estimate_light([evidence], GREY).weights
    assert np.isfinite(found).all()
    assert found.min() >= 0
    assert np.array_equal(found, estimate_light([evidence], GREY).weights)
    assert float(environment(gradient(), found).min()) >= 0


def test_light_that_a_picture_does_not_show_stays_the_mean(white: ndarray) -> None:
    evidence = evidence_of(
        shown(white, 2 * np.ones((3, LOBES)), PAINT),
        np.broadcast_to(PAINT, white.shape[:2]),
        white,
    )
    found = environment(gradient(), estimate_light([evidence], GREY).weights) / gradient()
    assert float(found[ROWS // 2, 0].mean()) == pytest.approx(2, abs=0.1)  # +Z, at the seam
    assert float(found[ROWS // 2, ROWS].mean()) < 1.6  # -Z, behind


Scene = tuple[Callable[[Materials, Tensor], Rendering], Materials, tuple[int, ...]]


@pytest.fixture(scope="module")
def scene() -> Scene:
    """A car of two colours, seen with little noise."""
    surface = load_embedding("hemispherical", {"resolution": 32}).embed(build_vehicle(sample_vehicle("van", 5)))
    renderer = load_renderer("mitsuba", {"device": "cpu"})
    prepared, camera = renderer.prepare(surface), Camera.orbit(0.7, 0.3, 1.9, (0.0, 0.2, 0.0), math.radians(36))

    def render(materials: Materials, radiance: Tensor) -> Rendering:
        return renderer.render(prepared, materials, View(camera, Environment(radiance), 32, 32), spp=64, seed=1)

    body = [part.name.startswith("body") for part in surface.parts]
    colors = [tuple(PAINT.tolist()) if one else (0.04, 0.04, 0.05) for one in body]
    materials = Materials(tuple(Material.lambertian(color) for color in colors))
    return render, materials, tuple(part for part, one in enumerate(body) if one)


def test_the_light_of_a_picture_of_a_mesh_is_estimated(scene: Scene) -> None:
    """Through the renderer: base and light explain the picture, and the base is the paint's."""
    render, clean, learnable = scene
    sun = gradient() * (1 + 14 * lobes(ROWS, 2 * ROWS)[[20, 21, 33]].sum(dim=0)).unsqueeze(-1)
    matt = Materials(tuple(Material.lambertian(part.base_color + 0.02) for part in clean.parts))
    evidence = gather_evidence(render(matt, sun), render, clean, learnable, gradient())
    assert len(evidence.radiance) > 100
    assert np.abs(evidence.base / PAINT - 1).mean() < 0.05
    found = environment(gradient(), estimate_light([evidence], GREY).weights)
    made, true, mean = (render(clean, one).image for one in (found, sun, gradient()))
    seen = true.sum(dim=-1) > 0.05
    assert float((made[seen] / true[seen] - 1).abs().median()) < 0.1
    assert float((mean[seen] / true[seen] - 1).abs().median()) > 0.3


@pytest.mark.full
def test_a_larger_picture_is_downsampled_first(scene: Scene) -> None:
    render, clean, learnable = scene
    picture = render(clean, gradient())
    larger = Rendering(picture.image.repeat_interleave(2, 0), picture.coverage.repeat_interleave(2, 0))
    larger = Rendering(larger.image.repeat_interleave(2, 1), larger.coverage.repeat_interleave(2, 1))
    one, other = (gather_evidence(one, render, clean, learnable, gradient()) for one in (picture, larger))
    assert np.allclose(one.radiance, other.radiance, rtol=1e-5)
    assert (evidence_size(640, 480), evidence_size(40, 64), evidence_size(9, 2000)) == ((64, 48), (40, 64), (1, 64))


def test_too_little_evidence_is_refused(scene: Scene) -> None:
    render, clean, learnable = scene
    nothing = Rendering(torch.zeros(32, 32, 3), torch.zeros(32, 32))
    with pytest.raises(AssetError, match="light: mean"):
        gather_evidence(nothing, render, clean, learnable, gradient())
