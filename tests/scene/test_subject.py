"""Which of a file's materials reach the renderers, and when."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest
import torch
import trimesh
from svbrdfgan_hemispherical import HemisphericalEmbedding

from svbrdfgan.config.choices import PartSelection
from svbrdfgan.data.exemplars import Exemplars
from svbrdfgan.errors import AssetError
from svbrdfgan.geometry.layers import embed_and_rasterize
from svbrdfgan.io.mesh import load_mesh
from svbrdfgan.scene.cache import load_subject, save_subject
from svbrdfgan.scene.loader import subject_key
from svbrdfgan.scene.subject import Subject, bake_subject, make_subject
from svbrdfgan.types import FileMap, Layer, Mesh, Part
from svbrdfgan.utils.memory import limited

DECLARED = {"roughness": 0.25, "metallic": 0.5, "normal": 0.0}
RAMP = ((np.arange(8) + 0.5) / 8).astype(np.float32)[None, :, None]
TILTED = np.tile(np.float32([0.48, 0.36, 0.8]), (2, 2, 1))
SMOOTH = {"roughness": FileMap((0.1,)), "metallic": FileMap((0.0,))}
METAL = {"roughness": FileMap((0.2,)), "metallic": FileMap((1.0,))}
PARTS = (
    Part("body", (0.5, 0.1, 0.1), file_maps={**METAL, "normal": FileMap((1.0, 1.0, 1.0), TILTED)}),
    Part("chrome wheel", (0.9, 0.9, 0.9), file_maps={**METAL, "normal": FileMap((1.0, 1.0, 1.0), TILTED)}),
    Part("glass", (0.1, 0.1, 0.1), file_maps={**SMOOTH, "alpha": FileMap((0.3,))}),
    Part("interior", (0.2, 0.2, 0.2), file_maps={"roughness": FileMap((1.0,), RAMP), "alpha": FileMap((1.0,), RAMP)}),
    Part("rubber", (0.02, 0.02, 0.02)),
)


@pytest.fixture(scope="module")
def mesh() -> Mesh:
    """Slabs on top of each other, one of each part, under one that is hollow; each has UVs of its own."""
    slabs = []
    for level in range(len(PARTS)):
        slab = trimesh.creation.box((1.0, 0.2, 2.0))
        slab.apply_translation((0.0, 0.15 + 0.25 * level, 0.0))
        slabs.append(slab)
    hood = trimesh.creation.box((1.4, 0.1, 0.6))
    hood.apply_translation((0.0, 0.5, 1.5))
    both = trimesh.util.concatenate([*slabs, hood])
    part = np.repeat([*range(len(PARTS)), 0], 12)
    positions, faces = np.asarray(both.vertices), np.asarray(both.faces)
    uv = positions[faces][..., [0, 2]] / 2 + 0.5
    return Mesh(positions, faces, part, PARTS, uv)


def subject_of(mesh: Mesh, *, file_maps: bool) -> Subject:
    return make_subject(mesh, HemisphericalEmbedding(resolution=32), 32, PartSelection(), file_maps=file_maps)


@pytest.fixture(scope="module")
def subject(mesh: Mesh) -> Subject:
    return subject_of(mesh, file_maps=True)


def by_name(subject: Subject, maps: Mapping[str, float], layer: torch.Tensor | None = None) -> dict[str, dict]:
    names = [part.name for part in subject.surface.parts]
    materials = subject.materials(None if layer is None else Layer(layer, tuple(maps)), maps)
    return {name: dict(material.maps) for name, material in zip(names, materials.parts, strict=True)}


def test_without_declared_maps_all_is_lambertian_and_opaque_as_it_was(mesh: Mesh, subject: Subject) -> None:
    plain = subject_of(mesh, file_maps=False)
    assert all(part.opaque for part in plain.surface.parts)
    for maps in (by_name(plain, {}), by_name(subject, {})):
        assert all(given.keys() == {"base_color"} for given in maps.values())
    for one, other in zip(plain.base, subject.base, strict=True):
        assert torch.equal(one, other)


def test_declared_maps_are_the_file_s_on_parts_that_are_not_learned(subject: Subject) -> None:
    made = by_name(subject, DECLARED, torch.rand(32, 32, 9))
    chrome, glass, inside, rubber = (made[name] for name in ("chrome wheel", "glass", "interior", "rubber"))
    assert (float(chrome["roughness"]), float(chrome["metallic"])) == (pytest.approx(0.2), 1.0)
    assert chrome["normal"].shape == (32, 32, 3)
    torch.testing.assert_close(chrome["normal"].norm(dim=-1), torch.ones(32, 32))
    torch.testing.assert_close(chrome["normal"][..., 2], torch.full((32, 32), 0.8))
    assert glass.keys() == {"base_color", "roughness", "metallic"}
    assert float(glass["roughness"]) == pytest.approx(0.1)
    assert inside["roughness"].shape == (32, 32, 1)
    assert rubber.keys() == {"base_color"}  # its file says nothing of gloss


def test_maps_that_are_not_declared_are_not_rendered(subject: Subject) -> None:
    made = by_name(subject, {"roughness": 0.25}, torch.rand(32, 32, 5))
    assert {name for maps in made.values() for name in maps} == {"base_color", "roughness"}


def test_learnable_parts_have_the_declared_values_under_the_layer(subject: Subject) -> None:
    layer = torch.rand(32, 32, 9)
    bare, made = by_name(subject, DECLARED), by_name(subject, DECLARED, layer)
    learned = {subject.surface.parts[part].name for part in subject.learnable}
    assert learned == {"body"}
    assert torch.equal(bare["body"]["roughness"], torch.tensor([0.25]))
    assert torch.equal(bare["body"]["normal"], torch.tensor([0.0, 0.0, 1.0]))
    expected = torch.tensor([0.0, 0.0, 1.0]) * (1 - layer[..., 3:4]) + layer[..., 6:] * layer[..., 3:4]
    torch.testing.assert_close(made["body"]["normal"], expected)


def test_hidden_halves_are_like_their_parts(subject: Subject) -> None:
    made, hidden = by_name(subject, DECLARED, torch.rand(32, 32, 9)), 0
    parts = {part.name: part for part in subject.surface.parts}
    for name, maps in made.items():
        if not parts[name].hidden:
            continue
        hidden += 1
        whole = made[parts[name].mesh_part]
        assert maps.keys() == whole.keys()
        assert parts[name].opaque == parts[parts[name].mesh_part].opaque
        if name == "body (hidden)":
            assert torch.equal(maps["roughness"], torch.tensor([0.25]))
        else:
            assert all(torch.equal(maps[key], whole[key]) for key in maps if maps[key].ndim == whole[key].ndim == 1)
    assert hidden >= 2


def test_alpha_is_of_the_surface(subject: Subject) -> None:
    parts = {part.name: part for part in subject.surface.parts}
    assert parts["glass"].alpha == pytest.approx(0.3)
    assert parts["body"].opaque
    inside = parts["interior"].alpha
    assert isinstance(inside, np.ndarray)
    assert inside.shape == (32, 32)
    assert inside.min() < inside.max() <= 1


def test_it_returns_from_its_file_as_it_was(subject: Subject, tmp_path: Path) -> None:
    save_subject(tmp_path / "a.safetensors", subject)
    loaded = load_subject(tmp_path / "a.safetensors", 32)
    layer = torch.rand(32, 32, 9)
    for one, other in zip(
        by_name(subject, DECLARED, layer).values(), by_name(loaded, DECLARED, layer).values(), strict=True
    ):
        assert one.keys() == other.keys()
        assert all(torch.equal(one[name], other[name]) for name in one)
    for one, other in zip(subject.surface.parts, loaded.surface.parts, strict=True):
        np.testing.assert_array_equal(np.asarray(one.alpha), np.asarray(other.alpha))
        assert isinstance(one.alpha, float) == isinstance(other.alpha, float)


def test_scenes_that_declare_maps_have_a_subject_of_their_own(tiny_exemplars: Exemplars) -> None:
    """So that none of those baked before is taken for one that knows its file's materials."""
    scene = tiny_exemplars.scenes[0]
    glossy, metallic = (
        scene.model_copy(update={"maps": maps}) for maps in ({"roughness": 0.5}, {"roughness": 0.1, "metallic": 0.0})
    )
    assert subject_key(glossy) == subject_key(metallic) != subject_key(scene)


def test_a_layer_without_the_declared_maps_is_refused(subject: Subject) -> None:
    with pytest.raises(AssetError, match="a layer paints base_color; wanted base_color, roughness, metallic, normal"):
        subject.materials(Layer(torch.rand(32, 32, 4)), DECLARED)


def test_by_default_what_the_file_says_is_under_all_maps_of_a_layer(subject: Subject) -> None:
    layer = Layer(torch.rand(32, 32, 5), ("roughness",))
    made, wanted = subject.materials(layer), subject.materials(layer, {"roughness": None})
    for one, other in zip(made.parts, wanted.parts, strict=True):
        assert one.maps.keys() == other.maps.keys()
        assert all(torch.equal(one.maps[name], other.maps[name]) for name in one.maps)


@pytest.mark.parametrize("name", ["cesium_milk_truck", "quaternius_real_suv"])
def test_real_glass_and_tyres_have_their_file_s_gloss(assets: Path, name: str) -> None:
    subject = subject_of(load_mesh(assets / "cars" / f"{name}.glb"), file_maps=True)
    made = by_name(subject, {"roughness": 0.25, "metallic": 0.0})
    others = [
        n
        for n, part in enumerate(subject.surface.parts)
        if part.mesh_part not in {subject.surface.parts[k].name for k in subject.learnable}
    ]
    assert others
    for part in others:
        maps = made[subject.surface.parts[part].name]
        assert (float(maps["roughness"]), float(maps["metallic"])) == (pytest.approx(0.6), 0.0)


def test_the_file_s_roughness_is_that_of_the_point_that_the_texel_shows(mesh: Mesh, subject: Subject) -> None:
    names = [part.name for part in subject.surface.parts]
    rough = subject.file_maps[names.index("interior")]["roughness"][..., 0]
    seen = subject.buffer.part == names.index("interior")
    assert seen.sum() > 10
    u = subject.buffer.position[..., 0] / 2 + 0.5
    inner = seen & (u > 1 / 16) & (u < 15 / 16)
    torch.testing.assert_close(rough[inner], u[inner], atol=1e-4, rtol=0)


def test_more_textures_than_memory_holds_are_refused_with_what_would_fit(mesh: Mesh) -> None:
    fragments = embed_and_rasterize(HemisphericalEmbedding(resolution=32), mesh, 32)
    said = r"parts with textures of their own at 32 x 32 texels need about .* would fit"
    with limited(32 * 32 * 4 * 100 // 4):
        with pytest.raises(AssetError, match=said):
            bake_subject(mesh, fragments, PartSelection(), file_maps=True)
        bake_subject(mesh, fragments, PartSelection())  # no part has a texture of its colour
