"""Imports of simulated pictures err as their light, camera and gloss say."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import torch
from torch import Tensor

from svbrdfgan.config.choices import PartSelection
from svbrdfgan.data.photos.bootstrap import Believe, Picture, simulated_errors
from svbrdfgan.data.photos.light import GLOSS, Evidence, gather_evidence
from svbrdfgan.data.reflectance_errors import with_errors
from svbrdfgan.geometry.camera_hits import camera_hits
from svbrdfgan.plugins.registry import load_embedding, load_renderer
from svbrdfgan.procedural.kinds import sample_vehicle
from svbrdfgan.procedural.vehicle import build_vehicle
from svbrdfgan.scene.subject import make_subject
from svbrdfgan.types import Camera, Environment, Material, Materials, Rendering, View

SIZE = (64, 48)
EVEN = torch.ones(8, 16, 3)
PAINT, DIRT = (0.45, 0.3, 0.3), (0.2, 0.2, 0.2)

Errors = Callable[..., Tensor]


def camera(turned: float = 0.0) -> Camera:
    return Camera.orbit(0.7 + turned, 0.3, 1.9, (0.0, 0.2, 0.0), math.radians(36))


@pytest.fixture(scope="module")
def picture() -> Picture:
    embedding = load_embedding("hemispherical", {"resolution": 32})
    subject = make_subject(build_vehicle(sample_vehicle("van", 5)), embedding, 32, PartSelection())
    renderer = load_renderer("mitsuba", {"device": "cpu"})
    prepared = renderer.prepare(subject.surface)

    def seen(materials: Materials, radiance: Tensor) -> Rendering:
        return renderer.render(prepared, materials, View(camera(), Environment(radiance), *SIZE), spp=64, seed=1)

    clean = Materials(tuple(Material.lambertian(PAINT) for _ in subject.surface.parts))
    evidence = gather_evidence(seen(clean, EVEN), seen, clean, subject.learnable, EVEN)
    return Picture(subject, camera(), SIZE, evidence, np.zeros((len(evidence.base), 1)), DIRT)


@pytest.fixture(scope="module")
def errors(picture: Picture) -> Errors:
    """The errors of an import that believes in even light, unless told otherwise."""
    renderer = load_renderer("mitsuba", {"device": "cpu"})
    prepared = renderer.prepare(picture.subject.surface)

    def render(materials: Materials, view: View) -> Tensor:
        return renderer.render(prepared, materials, view, spp=256, seed=1).image

    def make(
        light: Tensor = EVEN, turned: float = 0.0, believe: Believe = lambda _: Environment(EVEN), of: Picture = picture
    ) -> Tensor:
        rng = np.random.default_rng(3)
        return simulated_errors(of, Environment(light), camera(turned), believe, render, rng)

    return make


def painted(picture: Picture, errors: Tensor) -> Tensor:
    """The errors, where the picture shows nothing but learnable parts."""
    hits = camera_hits(picture.subject.surface, camera(), *SIZE, per_pixel=3)
    inside = np.isin(hits.part, picture.subject.learnable).reshape(SIZE[1], 3, SIZE[0], 3).all(axis=(1, 3))
    return errors[torch.from_numpy(inside)]


def test_a_right_import_errs_by_gloss_alone(picture: Picture, errors: Errors) -> None:
    found = painted(picture, errors())
    assert len(found) > 200
    gain, offset, shift = found.split((3, 3, 2), dim=-1)
    assert float((gain - gain.median()).abs().median()) < 0.03
    assert 0.85 < float(gain.median()) <= 1.02  # gloss is taken for light: the picture is exposed for it
    assert 0.0 < float(offset.median() + GLOSS) < 0.1
    assert float(shift.abs().max()) < 1e-3


def test_brightness_is_no_error_and_direction_is(picture: Picture, errors: Errors) -> None:
    assert torch.allclose(errors(7.0 * EVEN), errors(), atol=0.02)
    above = EVEN * torch.linspace(1.9, 0.1, 8)[:, None, None]
    gain = painted(picture, errors(above))[:, :3].mean(dim=-1)
    assert float(gain.quantile(0.9) / gain.quantile(0.1)) > 1.5
    right = painted(picture, errors(above, believe=lambda _: Environment(above)))[:, :3].mean(dim=-1)
    assert float(right.quantile(0.9) / right.quantile(0.1)) < 1.1


def test_color_of_the_light_that_nobody_estimates_is_in_the_gain(picture: Picture, errors: Errors) -> None:
    gain = painted(picture, errors(EVEN * torch.tensor([2.0, 1.0, 0.5])))[:, :3].median(dim=0).values
    assert torch.allclose(gain / gain[1], torch.tensor([2.0, 1.0, 0.5]), rtol=0.03)


def test_weathering_that_is_taken_for_light_is_in_the_gain(picture: Picture, errors: Errors) -> None:
    """Bright dirt everywhere: the import exposes the picture as if it were paint, and so too dark."""
    dirty = replace(picture, shares=np.ones_like(picture.shares), dirt=(1.8, 1.2, 1.2))
    clean, covered = (float(painted(picture, errors(of=one))[:, :3].median()) for one in (picture, dirty))
    assert covered < 0.8 * clean


def test_the_shift_leads_to_the_same_point_in_the_believed_camera(picture: Picture, errors: Errors) -> None:
    turned = math.radians(4.0)
    surface = picture.subject.surface
    here, there = (camera_hits(surface, one, *SIZE) for one in (camera(), camera(turned)))
    places = [torch.from_numpy(hits.interpolate(surface.positions)).float() for hits in (here, there)]
    shift = errors(turned=turned)
    shift[..., :3], shift[..., 3:6] = 1.0, 0.0
    found = with_errors(places[0][None], shift[None])[0]
    whole = torch.from_numpy(np.isin(there.part, picture.subject.learnable))
    gaps = [(one - places[1])[whole].norm(dim=-1).median() for one in (found, places[0])]
    assert float(gaps[0]) < 0.3 * float(gaps[1])


def test_an_import_is_told_what_the_simulated_picture_shows(picture: Picture, errors: Errors) -> None:
    told: list[Evidence] = []

    def believe(evidence: Evidence) -> Environment:
        told.append(evidence)
        return Environment(EVEN)

    errors(believe=believe)
    (evidence,) = told
    ratio = evidence.radiance / (evidence.base * evidence.white.sum(axis=-1))
    assert np.median(ratio) == pytest.approx(1.0, rel=0.1)  # exposed like a picture


def test_a_simulated_picture_shows_a_draw_of_the_model_that_is_known(picture: Picture, errors: Errors) -> None:
    """Twice as bright as the paint: the import exposes it down to the paint, which it expects."""
    known = replace(picture, evidence=replace(picture.evidence, draws=2 * picture.evidence.base[None]))
    clean, bright = (float(painted(picture, errors(of=one))[:, :3].median()) for one in (picture, known))
    assert bright == pytest.approx(0.5 * clean, rel=0.1)
