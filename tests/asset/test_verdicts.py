"""Verdicts on parts: by name, place, shape and looks, and as the user's patterns say."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from svbrdfgan.asset.asset import Asset, load_asset
from svbrdfgan.asset.part_words import shades, split_words, telling
from svbrdfgan.asset.verdicts import Verdict, judge, warnings
from svbrdfgan.asset.wheels import find_wheels
from svbrdfgan.io.gltf.document import read_document, write_document
from svbrdfgan.io.gltf.surface_files import save_mesh_glb
from svbrdfgan.procedural.kinds import sample_vehicle
from svbrdfgan.procedural.vehicle import build_vehicle
from svbrdfgan.types import FileMap, Mesh, Part

GLOSS = {"roughness": FileMap((0.6,)), "metallic": FileMap((0.0,))}
BODY = trimesh.creation.box((1.6, 1.0, 4.0)).apply_translation((0, 0.9, 0))


def joined(shapes: list[trimesh.Trimesh]) -> trimesh.Trimesh:
    whole = trimesh.util.concatenate(shapes)
    assert isinstance(whole, trimesh.Trimesh)
    return whole


def wheel(x: float, z: float, sections: int = 24) -> trimesh.Trimesh:
    """A wheel that stands on y = 0, of radius 0.35."""
    turned = trimesh.creation.cylinder(0.35, 0.2, sections=sections)
    turned.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, (0, 1, 0)))
    return turned.apply_translation((x, -turned.bounds[0, 1], z))


WHEELS = joined([wheel(x, z) for x in (-0.8, 0.8) for z in (-1.3, 1.3)])


def mesh_of(shapes: Mapping[str, trimesh.Trimesh], **parts: Part) -> Mesh:
    starts = np.cumsum([0, *(len(shape.vertices) for shape in shapes.values())])
    return Mesh(
        np.concatenate([shape.vertices for shape in shapes.values()]),
        np.concatenate([shape.faces + start for shape, start in zip(shapes.values(), starts, strict=False)]),
        np.repeat(np.arange(len(shapes)), [len(shape.faces) for shape in shapes.values()]),
        tuple(parts.get(name, Part(name, (0.5, 0.2, 0.2), file_maps=GLOSS)) for name in shapes),
    )


def asset_of(path: Path, mesh: Mesh, **materials: dict[str, Any]) -> Asset:
    """The asset of a mesh, with keys laid over materials of its document."""
    save_mesh_glb(path, mesh)
    document = read_document(path)
    for material in document.table("materials"):
        material.update(materials.get(material["name"], {}))
    write_document(path, document)
    return load_asset(path)


def by_name(verdicts: tuple[Verdict, ...]) -> dict[str, Verdict]:
    return {verdict.name: verdict for verdict in verdicts}


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / "a.glb"


@pytest.mark.parametrize("kind", ["van", "pickup"])
def test_of_a_procedural_vehicle_body_and_trim_weather(kind: str, file: Path) -> None:
    verdicts = by_name(judge(asset_of(file, build_vehicle(sample_vehicle(kind, 5)))))
    assert {name for name, verdict in verdicts.items() if verdict.weathers} == {"body", "trim"}
    assert sum(verdict.area for verdict in verdicts.values()) == pytest.approx(1.0)


def test_without_names_wheels_are_found_by_their_shape(file: Path) -> None:
    mesh = build_vehicle(sample_vehicle("van", 5))
    coded = replace(mesh, parts=tuple(replace(part, name=f"m{k}") for k, part in enumerate(mesh.parts)))
    kinds = {name: verdict.kind for name, verdict in by_name(judge(asset_of(file, coded))).items()}
    tyre, rim = (f"m{[part.name for part in mesh.parts].index(name)}" for name in ("tyre", "rim"))
    assert (kinds[tyre], kinds[rim]) == ("tyre", "rim")
    assert [name for name, kind in kinds.items() if kind in ("tyre", "rim", "wheel")] == [tyre, rim]


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        *(("Primary", "paint"), ("trim", "trim"), ("rims", "rim"), ("wheel_rim", "rim"), ("WheelRim.001", "rim")),
        *(("rezina", "rubber"), ("tier_1o", "tyre"), ("Reifen_vorne", "tyre"), ("pneuAV", "tyre"), ("carTire", "tyre")),
        *(("Scheibe", "glass"), ("vitre-avant", "glass"), ("frontglass", "glass"), ("FiberGlass", None)),
        ("License", "plate"),
        *(("window_frame", "trim"), ("wheel_arch", "trim"), ("headlight_housing", "trim")),
        *(("RRRX7_BrakeLight", "lamp"), ("phare", "lamp"), ("Scheinwerfer", "lamp"), ("clamp", None)),
        *(("SteeringWheel", "interior"), ("Lenkrad", "interior"), ("Rücklicht", "lamp"), ("Material.003", None)),
    ],
)
def test_whole_words_of_several_languages_tell(name: str, kind: str | None) -> None:
    found = telling(name)
    assert (found.kind if found else None) == kind


def test_words_are_cut_at_camel_case_signs_and_digits() -> None:
    assert split_words("RRRX7VS_HeadLights.001") == ("rrrx", "vs", "head", "lights")
    assert split_words("Vidrio-Atrás2") == ("vidrio", "atras")


def test_light_beside_dark_is_a_shade() -> None:
    assert telling("Main_Light", shades(("Main", "Main_Dark"))) is None
    assert telling("Main_Light", shades(("Main",))) is not None


def test_a_lamp_that_is_the_whole_object_weathers(file: Path) -> None:
    mesh = mesh_of({"Lamp": BODY, "bulb": wheel(0, 3)})
    verdicts = by_name(judge(asset_of(file, mesh)))
    assert verdicts["Lamp"].weathers
    assert not verdicts["Lamp"].sure
    assert not verdicts["bulb"].weathers


def test_cloth_is_kept_unless_it_is_called_otherwise(file: Path) -> None:
    shapes = {name: BODY.copy().apply_translation((0, k, 0)) for k, name in enumerate(("base", "cover", "body_top"))}
    cloth = {"extensions": {"KHR_materials_sheen": {"sheenColorFactor": [0.2, 0.2, 0.2]}}}
    verdicts = by_name(judge(asset_of(file, mesh_of(shapes), cover=cloth, body_top=cloth)))
    assert [verdicts[name].weathers for name in shapes] == [True, False, True]


def test_what_light_passes_is_kept_whatever_it_is_called(file: Path) -> None:
    clear = Part("body_top", (0.1, 0.1, 0.1), file_maps={**GLOSS, "alpha": FileMap((0.3,))})
    shapes = {name: BODY.copy().apply_translation((0, k, 0)) for k, name in enumerate(("base", "paint_a", "body_top"))}
    passing = {"extensions": {"KHR_materials_transmission": {"transmissionFactor": 0.9}}}
    verdicts = by_name(judge(asset_of(file, mesh_of(shapes, body_top=clear), paint_a=passing)))
    assert [verdicts[name].kind for name in shapes] == ["body", "glass", "glass"]
    assert [verdicts[name].weathers for name in shapes] == [True, False, False]


def test_blending_that_is_opaque_everywhere_is_no_glass(file: Path) -> None:
    verdicts = judge(asset_of(file, mesh_of({"a": BODY, "b": WHEELS}), a={"alphaMode": "BLEND"}))
    assert by_name(verdicts)["a"].weathers


def test_small_things_that_emit_light_are_lamps(file: Path) -> None:
    small = trimesh.creation.box((0.2, 0.2, 0.2)).apply_translation((0, 1, 2.1))
    glowing = {"emissiveFactor": [1, 1, 0.5]}
    verdicts = by_name(judge(asset_of(file, mesh_of({"a": BODY, "b": small}), a=glowing, b=glowing)))
    assert (verdicts["a"].kind, verdicts["b"].kind) == ("body", "lamp")


def test_a_texture_counts_at_the_uvs_that_a_part_uses(file: Path) -> None:
    """Two metals share a texture of gloss, which is smooth on the left and rough on the right."""
    small = trimesh.creation.box((0.3, 0.1, 0.1))
    shapes = {
        "a": BODY,
        "b": small.copy().apply_translation((0, 1, 2)),
        "c": small.copy().apply_translation((0, 1, -2)),
    }
    gloss = np.ones((4, 8, 1), np.float32)
    gloss[:, :4] = 0.05
    metal = {"roughness": FileMap((1.0,), gloss), "metallic": FileMap((1.0,))}
    parts = {name: Part(name, (0.7, 0.7, 0.7), file_maps=metal) for name in ("b", "c")}
    mesh = mesh_of(shapes, **parts)
    place = np.array([0.5, 0.25, 0.75])[mesh.face_part][:, None, None]
    uv = np.broadcast_to(np.concatenate([place, np.full_like(place, 0.5)], axis=2), (len(mesh.faces), 3, 2)).copy()
    verdicts = by_name(judge(asset_of(file, replace(mesh, uv=uv))))
    assert (verdicts["b"].kind, verdicts["c"].kind) == ("chrome", "body")


def test_a_flat_sheet_under_the_vehicle_is_ground_and_does_not_move_its_box(file: Path) -> None:
    sheet = trimesh.creation.box((9.0, 0.001, 9.0)).apply_translation((0, -0.3, 0))
    verdicts = by_name(judge(asset_of(file, mesh_of({"a": BODY, "b": WHEELS, "c": sheet}))))
    assert [verdicts[name].kind for name in "abc"] == ["body", "wheel", "ground"]
    assert not verdicts["c"].weathers
    raised = sheet.copy().apply_translation((0, 2.0, 0))
    assert by_name(judge(asset_of(file, mesh_of({"a": BODY, "b": WHEELS, "c": raised}))))["c"].weathers


def test_what_other_parts_enclose_is_interior(file: Path) -> None:
    inner = trimesh.creation.box((0.6, 0.4, 1.0)).apply_translation((0, 0.9, 0))
    verdicts = by_name(judge(asset_of(file, mesh_of({"a": BODY, "b": inner}))))
    assert (verdicts["b"].kind, verdicts["b"].weathers, verdicts["a"].weathers) == ("interior", False, True)


@pytest.mark.parametrize(("sections", "found"), [(4, False), (6, True), (7, True), (9, True), (32, True)])
def test_polygons_from_six_corners_are_round(sections: int, found: bool) -> None:
    shape = joined([wheel(x, 0, sections) for x in (-1, 1)])
    faces = np.asarray(shape.faces, np.int64)
    wheels = find_wheels(np.asarray(shape.vertices), faces, np.zeros(len(faces), np.int64), 0.0, 1.5)
    assert wheels.inside.all() == found
    assert len(wheels.wheels) == (2 if found else 0)


def test_one_round_thing_is_no_wheel(file: Path) -> None:
    assert by_name(judge(asset_of(file, mesh_of({"a": BODY, "b": wheel(0, 1)}))))["b"].weathers


def test_a_frame_turns_the_file_upright(file: Path) -> None:
    shape = {"a": BODY.copy(), "b": WHEELS.copy()}
    for each in shape.values():
        each.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, (1, 0, 0)))  # Z is up
    asset = asset_of(file, mesh_of(shape))
    upright = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
    assert by_name(judge(asset))["b"].weathers
    assert by_name(judge(asset, orientation=upright))["b"].kind == "wheel"


def test_patterns_change_only_what_they_match(file: Path) -> None:
    asset = asset_of(file, build_vehicle(sample_vehicle("van", 5)))
    plain, asked = judge(asset), judge(asset, learnable=("GLASS", "rim"), keep=("r*", "body"))
    changed = {a.name: b.weathers for a, b in zip(plain, asked, strict=True) if a.weathers != b.weathers}
    assert changed == {"glass": True, "body": False}
    assert by_name(asked)["rim"].reason == "--keep 'r*'"


def test_warnings_name_what_helps(file: Path) -> None:
    one = asset_of(file, mesh_of({"a": BODY, "b": WHEELS}))
    (painted,) = warnings(judge(one), one)
    assert "--keep" in painted
    assert "--mask" in painted
    (nothing,) = warnings(judge(one, keep=("*",)), one)
    assert "nothing of a.glb weathers" in nothing
    (largest,) = warnings(judge(one, keep=("a",), learnable=("b",)), one)
    assert "the largest part, 'a', is kept" in largest
    pane = trimesh.creation.box((0.01, 0.4, 1.0)).apply_translation((0.8, 1.2, 0))
    glazed = asset_of(file, mesh_of({"a": BODY, "b": WHEELS, "window": pane}))
    assert warnings(judge(glazed), glazed) == []


@pytest.mark.full
def test_thousands_of_pieces_are_judged_in_seconds(file: Path) -> None:
    """Two thousand instances took minutes."""
    begun, count = time.process_time(), 2000
    document = asset_of(file, mesh_of({"body": trimesh.creation.box((1.0, 1.0, 3.0))})).document
    document.header["nodes"] = [{"mesh": 0, "name": f"n{k}", "translation": [2.0 * k, 0, 0]} for k in range(count)]
    document.header["scenes"] = [{"nodes": [*range(count)]}]
    write_document(file, document)
    assert len(judge(load_asset(file))) == count
    assert time.process_time() - begun < 60.0
