"""Gloss is declared: only where the learned layer has no dirt, and on the parts that are named."""

import pytest
import torch

from svbrdfgan.config.choices import PartSelection
from svbrdfgan.experiments.demo.gloss import PAINT, matt_dirt, polished
from svbrdfgan.plugins.registry import load_embedding
from svbrdfgan.procedural.kinds import sample_vehicle
from svbrdfgan.procedural.vehicle import build_vehicle
from svbrdfgan.scene.subject import Subject, make_subject
from svbrdfgan.types import Layer, Material


@pytest.fixture(scope="module")
def subject() -> Subject:
    mesh = build_vehicle(sample_vehicle("sedan", seed=3))
    return make_subject(mesh, load_embedding("hemispherical"), 32, PartSelection())


@pytest.fixture(scope="module")
def materials(subject: Subject) -> dict[str, Material]:
    """By part, under a layer that is dirty in the upper half of the texture."""
    layer = Layer(torch.zeros(32, 32, 4))
    layer.values[16:] = 1.0
    made = polished(subject).materials(matt_dirt(layer), PAINT)
    return {part.name: material for part, material in zip(subject.surface.parts, made.parts, strict=True)}


def test_paint_is_glossy_and_dirt_is_rough(materials: dict[str, Material]) -> None:
    roughness = materials["body"].maps["roughness"]
    assert torch.allclose(roughness[:16], torch.tensor(PAINT["roughness"]))
    assert torch.allclose(roughness[16:], torch.tensor(0.9))
    assert (materials["body"].maps["metallic"] == 0).all()


def test_glass_and_rims_are_polished_and_tyres_are_not(materials: dict[str, Material]) -> None:
    assert float(materials["glass"].maps["roughness"]) < 0.2
    assert float(materials["rim"].maps["metallic"]) == 1.0
    assert materials["tyre"].maps.keys() == {"base_color"}


def test_colours_are_those_that_were_learned(subject: Subject, materials: dict[str, Material]) -> None:
    layer = Layer(torch.zeros(32, 32, 4))
    layer.values[16:] = 1.0
    (body,) = subject.learnable
    assert torch.equal(materials["body"].base_color, subject.materials(layer).parts[body].base_color)
