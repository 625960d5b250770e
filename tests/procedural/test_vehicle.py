"""Procedural vehicles: where they stand, what they are made of, and that they differ."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from jaxtyping import Float
from numpy import ndarray

from svbrdfgan.config.choices import PartSelection
from svbrdfgan.errors import ConfigError
from svbrdfgan.plugins.registry import load_embedding
from svbrdfgan.procedural.kinds import KINDS, sample_vehicle
from svbrdfgan.procedural.shape import LIMITS
from svbrdfgan.procedural.vehicle import PART_NAMES, build_vehicle
from svbrdfgan.scene.subject import make_subject
from svbrdfgan.types import Mesh


@pytest.fixture(scope="module")
def vehicles() -> dict[str, Mesh]:
    return {kind: build_vehicle(sample_vehicle(kind, 3)) for kind in KINDS}


def _crosses(mesh: Mesh) -> Float[ndarray, "faces 3"]:
    a, b, c = (mesh.positions[mesh.faces[:, k]] for k in range(3))
    return np.cross(b - a, c - a)


def _volume(mesh: Mesh, chosen: ndarray) -> float:
    return float((mesh.positions[mesh.faces[chosen, 0]] * _crosses(mesh)[chosen]).sum()) / 6.0


def _side_view(mesh: Mesh) -> ndarray:
    """Height of the vehicle at 64 places along its length."""
    points = mesh.positions[mesh.faces].mean(axis=1)
    place = np.clip(((points[:, 2] + 0.5) * 64).astype(int), 0, 63)
    height = np.zeros(64)
    np.maximum.at(height, place, points[:, 1])
    return height


@pytest.mark.parametrize("kind", KINDS)
def test_stands_on_the_ground_centred_with_length_one(vehicles: dict[str, Mesh], kind: str) -> None:
    low, high = vehicles[kind].bounds
    shape = sample_vehicle(kind, 3)
    np.testing.assert_allclose([low[1], low[2], high[2], low[0] + high[0]], [0.0, -0.5, 0.5, 0.0], atol=1e-12)
    assert high[1] == pytest.approx(shape.height, rel=0.05)
    assert shape.width * 0.97 < high[0] - low[0] < shape.width + 0.09  # the mirrors stick out


@pytest.mark.parametrize("kind", KINDS)
def test_parts_are_named_and_all_there(vehicles: dict[str, Mesh], kind: str) -> None:
    mesh = vehicles[kind]
    assert tuple(part.name for part in mesh.parts) == PART_NAMES
    assert set(mesh.face_part) == set(range(len(PART_NAMES)))
    assert 2000 <= len(mesh.faces) <= 8000


@pytest.mark.parametrize("kind", KINDS)
def test_every_edge_joins_two_faces_that_wind_alike(vehicles: dict[str, Mesh], kind: str) -> None:
    faces = vehicles[kind].faces
    half = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    forward = np.unique(half, axis=0)
    assert len(forward) == len(half)
    np.testing.assert_array_equal(forward, np.unique(half[:, ::-1], axis=0))


@pytest.mark.parametrize("kind", KINDS)
def test_faces_look_outward(vehicles: dict[str, Mesh], kind: str) -> None:
    mesh = vehicles[kind]
    assert 0.03 < _volume(mesh, np.ones(len(mesh.faces), bool)) < 0.25
    outward = (_crosses(mesh) * mesh.positions[mesh.faces].mean(axis=1) * (1.0, 1.0, 0.0)).sum(axis=1)
    area = np.linalg.norm(_crosses(mesh), axis=1)
    body = mesh.face_part == PART_NAMES.index("body")
    assert area[body & (outward > 0)].sum() > 0.8 * area[body].sum()
    for x in (-1, 1):  # each side's wheels hold a volume of their own
        side = np.sign(mesh.positions[mesh.faces[:, 0], 0]) == x
        wheel = np.isin(mesh.face_part, [PART_NAMES.index("tyre"), PART_NAMES.index("rim")])
        assert _volume(mesh, side & wheel) > 0.0


@pytest.mark.parametrize("kind", KINDS)
def test_nose_and_lights_are_in_front(vehicles: dict[str, Mesh], kind: str) -> None:
    mesh = vehicles[kind]
    z = mesh.positions[mesh.faces].mean(axis=1)[:, 2]
    assert z[mesh.face_part == PART_NAMES.index("lights_front")].min() > 0.35
    assert z[mesh.face_part == PART_NAMES.index("lights_rear")].max() < -0.35


def test_triangles_are_not_slivers(vehicles: dict[str, Mesh]) -> None:
    for mesh in vehicles.values():
        points = mesh.positions[mesh.faces]
        longest = np.linalg.norm(points - np.roll(points, 1, axis=1), axis=2).max(axis=1)
        height = np.linalg.norm(_crosses(mesh), axis=1) / longest
        assert np.mean(height < 0.02 * longest) < 0.02


def test_paint_is_the_body_and_nothing_else() -> None:
    shape = sample_vehicle("sedan", 0)
    red = build_vehicle(replace(shape, paint=(0.5, 0.1, 0.1)))
    blue = build_vehicle(replace(shape, paint=(0.1, 0.1, 0.5)))
    np.testing.assert_array_equal(red.positions, blue.positions)
    assert red.parts[0].base_color == (0.5, 0.1, 0.1)
    assert red.parts[1:] == blue.parts[1:]


def test_glass_paint_and_rims_are_what_they_are_called(vehicles: dict[str, Mesh]) -> None:
    """As whole materials; where base colour alone is rendered, all is Lambertian and opaque as ever."""
    embedding, selection = load_embedding("hemispherical"), PartSelection()
    whole = make_subject(vehicles["sedan"], embedding, 16, selection, file_maps=True)
    looks = whole.materials(maps=dict.fromkeys(("roughness", "metallic")))
    found = {part.name: (part, look.maps) for part, look in zip(whole.surface.parts, looks.parts, strict=True)}
    assert [name for name, (part, _) in found.items() if not part.opaque and not part.hidden] == ["glass"]
    assert float(found["body"][1]["roughness"]) < float(found["trim"][1]["roughness"])
    assert [name for name, (part, maps) in found.items() if maps["metallic"] > 0 and not part.hidden] == ["rim"]
    plain = make_subject(vehicles["sedan"], embedding, 16, selection)
    assert all(part.opaque for part in plain.surface.parts)
    assert all(material.maps.keys() == {"base_color"} for material in plain.materials().parts)


def test_same_seed_same_vehicle() -> None:
    assert sample_vehicle("van", 5) == sample_vehicle("van", 5)
    first, second = (build_vehicle(sample_vehicle("van", 5)) for _ in range(2))
    np.testing.assert_array_equal(first.positions, second.positions)
    np.testing.assert_array_equal(first.faces, second.faces)


def test_samples_spread_over_their_ranges() -> None:
    for kind in KINDS:
        shapes = [sample_vehicle(kind, seed) for seed in range(40)]
        assert np.ptp([shape.height for shape in shapes]) > 0.03
        assert np.ptp([shape.wheel_radius for shape in shapes]) > 0.008
        assert len({shape.paint for shape in shapes}) == 40


def test_side_views_differ_within_and_between_kinds(vehicles: dict[str, Mesh]) -> None:
    views = [_side_view(mesh) for mesh in vehicles.values()]
    views += [_side_view(build_vehicle(sample_vehicle("sedan", seed))) for seed in range(3)]
    apart = [np.abs(a - b).max() for i, a in enumerate(views) for b in views[:i]]
    assert min(apart) > 0.012


def test_pickup_has_a_bed_and_the_others_a_roof(vehicles: dict[str, Mesh]) -> None:
    for kind, mesh in vehicles.items():
        points = mesh.positions[mesh.faces].mean(axis=1)
        behind = (points[:, 2] > -0.40) & (points[:, 2] < -0.30) & (np.abs(points[:, 0]) < 0.04)
        top = points[behind, 1].max() / mesh.bounds[1, 1]
        assert (top < 0.55) == (kind == "pickup"), (kind, top)


@pytest.mark.parametrize("end", [0, pytest.param(1, marks=pytest.mark.full)])
def test_every_limit_can_be_built(end: int) -> None:
    """One parameter at a time at the end of its range, the others as sampled."""
    shape = sample_vehicle("suv", 1)
    refused = set()
    for name, limit in LIMITS.items():
        try:
            change: dict[str, Any] = {name: limit[end]}
            extreme = replace(shape, **change)
        except ConfigError:
            refused.add(name)  # no room for the roof or the wheels
            continue
        mesh = build_vehicle(extreme)
        assert np.isfinite(mesh.positions).all()
        assert _volume(mesh, np.ones(len(mesh.faces), bool)) > 0.02, name
    assert refused <= {"front_overhang", "wheelbase", "hood_length", "deck_length", "windscreen_run"}


def test_unknown_kind_is_refused() -> None:
    with pytest.raises(ConfigError, match="known are sedan"):
        sample_vehicle("submarine", 0)


def test_impossible_values_are_refused() -> None:
    shape = sample_vehicle("sedan", 0)
    changes: list[dict[str, Any]] = [{"width": 2.0}, {"height": float("nan")}, {"paint": (2.0, 0.0, 0.0)}]
    for change in changes:
        with pytest.raises(ConfigError, match="wanted"):
            replace(shape, **change)
    with pytest.raises(ConfigError, match="roof"):
        replace(shape, hood_length=0.36, deck_length=0.45)
    with pytest.raises(ConfigError, match="seed"):
        sample_vehicle("sedan", -1)
