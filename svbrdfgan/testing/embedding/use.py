"""A test of use: a vehicle from mesh to weathered texture."""

from __future__ import annotations

import torch

from svbrdfgan.config.choices import PartSelection
from svbrdfgan.procedural.kinds import sample_vehicle
from svbrdfgan.procedural.vehicle import build_vehicle
from svbrdfgan.scene.subject import make_subject
from svbrdfgan.testing.embedding.base import EmbeddingKit
from svbrdfgan.testing.embedding.meshes import own_uv
from svbrdfgan.testing.kit import check
from svbrdfgan.types import Mesh
from svbrdfgan.weathering.layer import recipe_from_options, weather

_TEXELS = 16


class UseTests(EmbeddingKit):
    """The steps that the core takes with every embedding."""

    def test_a_vehicle_can_be_weathered(self) -> None:
        """A procedural sedan is embedded, its inner layers hidden, baked and weathered, at 16 x 16 texels."""
        mesh = _sedan()
        subject = make_subject(mesh, self.embedding, _TEXELS, PartSelection(exclude=()))
        recipe = recipe_from_options("road-dirt", {"amount": 0.7, "seed": 1})
        layer = weather(subject.surface, subject.buffer, recipe)
        albedo = subject.albedo(layer)
        check(albedo.shape == (_TEXELS, _TEXELS, 3), f"the weathered texture has shape {tuple(albedo.shape)}.")
        bad = int((~torch.isfinite(albedo) | (albedo < 0.0) | (albedo > 1.0)).sum())
        check(not bad, f"the weathered texture has {bad} values outside 0 to 1.")


def _sedan() -> Mesh:
    mesh = build_vehicle(sample_vehicle("sedan", seed=5))
    return Mesh(mesh.positions, mesh.faces, mesh.face_part, mesh.parts, own_uv(len(mesh.faces)))
