"""Two pictures from one tripod: of the clean object, or without the flash, and what an import makes of them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from stand_ins import SMALL
from torch import Tensor

from svbrdfgan.config.choices import PartSelection
from svbrdfgan.data.index import Dataset
from svbrdfgan.data.photos.build import import_pictures
from svbrdfgan.data.photos.light import GLOSS
from svbrdfgan.data.photos.manifest import read_manifest
from svbrdfgan.data.photos.pairs import USUAL_ROUGHNESS, FlashShading, reflectance_of_pair, relit, shading_of_pair
from svbrdfgan.data.photos.picture_renderer import PictureRenderer
from svbrdfgan.data.reflectance_errors import load_errors
from svbrdfgan.errors import ConfigError
from svbrdfgan.geometry.camera_hits import camera_hits
from svbrdfgan.io.gltf.surface_files import save_mesh_glb
from svbrdfgan.io.image import load_image, save_image
from svbrdfgan.plugins.registry import load_embedding, load_renderer
from svbrdfgan.procedural.kinds import sample_vehicle
from svbrdfgan.procedural.vehicle import build_vehicle
from svbrdfgan.rendering.checked_renderer import CheckedRenderer
from svbrdfgan.scene.description import OrbitCamera, Scene
from svbrdfgan.scene.loader import SceneLoader
from svbrdfgan.scene.subject import make_subject
from svbrdfgan.types import Environment, Layer, Rendering, View

PAINT, DIRT = (0.45, 0.1, 0.08), (0.3, 0.25, 0.18)
CAMERA = OrbitCamera(azimuth_degrees=40, elevation_degrees=15, distance=2.2, target=(0, 0.2, 0))
SIZE = (120, 80)
FLASH = (3.0, 2.4, 2.0)


@pytest.fixture(scope="module")
def base(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A van, dirty below, in a light that no pool has: dirty, clean, and dirty with a flash. Not to be changed."""
    folder = tmp_path_factory.mktemp("pairs")
    mesh = build_vehicle(sample_vehicle("van", 5))
    save_mesh_glb(folder / "van.glb", mesh)
    subject = make_subject(mesh, load_embedding("hemispherical", {}), 64, PartSelection())
    painted = dict.fromkeys((subject.surface.parts[part].name for part in subject.learnable), PAINT)
    renderer = CheckedRenderer(load_renderer("mitsuba", {"device": "cpu"}).plugin, "mitsuba")
    prepared, camera = renderer.prepare(subject.surface), CAMERA.camera()
    light = torch.full((16, 32, 3), 0.2)
    light[3:9, 4:10] = torch.tensor([6.0, 5.0, 4.0])
    clean, dirty = (subject.materials(layer(subject.buffer.position, share), base_colors=painted) for share in (0, 1))
    for name, materials in (("clean", clean), ("dirty", dirty)):
        picture = renderer.render(prepared, materials, View(camera, Environment(light), *SIZE), spp=512, seed=1).image
        save_image(folder / f"{name}.exr", picture)
    even, white = (
        renderer.render(prepared, each, View(camera, Environment(torch.ones(8, 16, 3)), *SIZE), spp=512, seed=1).image
        for each in (dirty, subject.materials(opaque(subject.buffer.position), base_colors=painted))
    )
    flash = FlashShading.of(camera_hits(subject.surface, camera, *SIZE)).values.unsqueeze(-1) * torch.tensor(FLASH)
    reflectance = torch.where(white > 0, even / white, 0.0)
    save_image(folder / "flash.exr", load_image(folder / "dirty.exr") + flash * reflectance)
    save_image(folder / "small.exr", torch.ones(40, 60, 3))
    return folder


def layer(position: Tensor, share: float) -> Layer:
    """Dirt below, whose edge is soft."""
    height = position[..., 1:2]
    covered = share * ((0.3 - height) / 0.1).clamp(0, 0.8)
    return Layer(torch.cat([torch.tensor(DIRT).expand(*height.shape[:2], 3), covered], dim=-1))


def opaque(position: Tensor) -> Layer:
    return Layer(torch.ones(*position.shape[:2], 4))


def manifest(**entry: Any) -> dict[str, Any]:
    camera = CAMERA.model_dump(mode="json")
    picture = {"file": "dirty.exr", "mesh": "van.glb", "camera": camera, "paint": list(PAINT), **entry}
    return {**SMALL, "embedding": "hemispherical", "texture": 64, "image": [96, 64], "pictures": [picture]}


def reflectance(data: dict[str, Any], base: Path, folder: Path) -> tuple[Tensor, Tensor]:
    """What an import says, and the truth, in pixels of paint."""
    import_pictures(read_manifest(data, "m.yaml"), folder, base=base)
    loader = SceneLoader(folder)
    scene = Scene.load(folder / "train" / "000000.json")
    subject = loader.subject(scene)
    renders = PictureRenderer(loader, CheckedRenderer(load_renderer("mitsuba", {"device": "cpu"}).plugin, "mitsuba"))
    made, dirty = renders.shaded(scene), renders.weathered(scene, [layer(subject.buffer.position, 1)])[0]
    hits = camera_hits(subject.surface, scene.camera.camera(), 3 * scene.width, 3 * scene.height)
    whole = np.isin(hits.part, subject.learnable).reshape(scene.height, 3, scene.width, 3).all(axis=(1, 3))
    lit = torch.from_numpy(whole) & (made.shading > 0.1 * made.shading.mean()).all(dim=-1)
    seen, true = load_image(folder / "train" / "000000.exr")[..., :3], renders.render(scene, dirty, 512).image
    found, wanted = ((picture - made.others.image)[lit] / made.shading[lit] for picture in (seen, true))
    assert len(found) > 300
    return found, wanted


def off(found: Tensor, wanted: Tensor) -> float:
    """The mean error, as a logarithm."""
    return float((found.clamp(min=1e-3) / wanted.clamp(min=1e-3)).log().abs().mean())


def test_a_picture_of_the_clean_object_takes_the_light_away(base: Path, tmp_path: Path) -> None:
    alone = off(*reflectance(manifest(), base, tmp_path / "alone"))
    pair = off(*reflectance(manifest(before="clean.exr"), base, tmp_path / "pair"))
    assert pair < 0.15
    assert pair < 0.6 * alone


def test_the_picture_of_a_flash_alone_needs_no_estimate(base: Path, tmp_path: Path) -> None:
    """One of unknown brightness is estimated, by the clean paint."""
    entry = {"file": "flash.exr", "without_flash": "dirty.exr"}
    measured = reflectance(manifest(**entry, flash=list(FLASH)), base, tmp_path / "measured")
    assert off(*measured) < 0.15
    assert float((measured[0] / measured[1]).median()) == pytest.approx(1.0, abs=0.05)
    unknown = reflectance(manifest(**entry), base, tmp_path / "unknown")
    assert float((unknown[0] / unknown[1]).median()) == pytest.approx(1.0, abs=0.2)


@pytest.mark.parametrize("entry", [{"before": "clean.exr"}, {"file": "flash.exr", "without_flash": "dirty.exr"}])
def test_imports_of_simulated_pairs_err_little(entry: dict[str, str], base: Path, tmp_path: Path) -> None:
    """By the camera's error of a degree, and by highlights; gains of single pictures are off by far more."""
    (record,) = import_pictures(
        read_manifest(manifest(**entry) | {"bootstrap": 3}, "m.yaml"), tmp_path / "own", base=base
    )
    assert record.uncertainty is not None
    assert 0 < record.uncertainty < 0.3
    errors = load_errors(Dataset.open(tmp_path / "own").folder, "train", 1)
    assert errors is not None
    gain, offset, _ = errors.values.float().split((3, 3, 2), dim=-1)
    assert errors.values.isfinite().all()
    assert float((gain.log() - gain.log().mean()).abs().median()) < 0.1
    assert float(offset.abs().median()) < 0.05


def test_gloss_is_told_from_shading_by_its_colour() -> None:
    base, estimated = torch.tensor(PAINT).expand(4, 3, 3), torch.tensor([1.0, 0.9, 0.8]).expand(4, 3, 3)
    shade, gloss = (
        torch.tensor([0.6, 1.0, 1.5, 1.0])[:, None, None],
        torch.tensor([0.02, 0.04, 0.02, 0.5])[:, None, None],
    )
    shading, known = shading_of_pair((shade * base + gloss) * estimated, base, estimated)
    assert known[:3].all()
    assert not known[3].any()
    torch.testing.assert_close((shading / estimated)[:3], shade[:3].expand(3, 3, 3), rtol=0.05, atol=0)


def test_where_nothing_changed_the_object_is_clean() -> None:
    base, shading = torch.rand(5, 4, 3), torch.rand(5, 4, 3) + 0.1
    shading[0] = 0.0  # no light
    before = base * shading + 0.03
    torch.testing.assert_close(reflectance_of_pair(before, before, base, shading), base)
    after = 0.5 * base * shading + 0.03
    torch.testing.assert_close(reflectance_of_pair(after, before, base, shading)[1:], 0.5 * base[1:])


def test_a_flash_falls_off_with_the_square_of_the_distance() -> None:
    subject = make_subject(
        build_vehicle(sample_vehicle("van", 5)), load_embedding("hemispherical", {}), 32, PartSelection()
    )
    near, far = (
        FlashShading.of(camera_hits(subject.surface, CAMERA.model_copy(update=changes).camera(), 40, 30))
        for changes in (
            {"distance": 10.0, "vertical_fov_degrees": 8.0},
            {"distance": 20.0, "vertical_fov_degrees": 4.0},
        )
    )
    both = near.clear & far.clear
    assert both.sum() > 100
    assert float((near.values / far.values)[both].median()) == pytest.approx(4.0, rel=0.1)
    power, albedo = torch.tensor(FLASH), torch.rand(30, 40, 3)
    seen = (albedo + near.gloss(USUAL_ROUGHNESS)) * near.values.unsqueeze(-1) * power
    found = near.reflectance(seen, power)
    torch.testing.assert_close(found[near.clear], albedo[near.clear], rtol=1e-3, atol=1e-3)
    assert (found[~near.clear] == 0).all()
    assert 0 < float(near.gloss(0.5)[near.clear].max()) < 0.2


def test_unknown_pixels_are_as_the_nearest_known_one() -> None:
    reflectance, known = torch.arange(12.0).reshape(2, 2, 3) / 12, torch.tensor([[True, False], [True, False]])
    others = Rendering(torch.full((2, 2, 3), 0.25), torch.ones(2, 2))
    shown = relit(reflectance, known, torch.full((2, 2, 3), 2.0), others).image
    torch.testing.assert_close(shown[:, 1], 2.0 * reflectance[:, 0] + 0.25)
    assert GLOSS < 0.05


@pytest.mark.parametrize(
    ("entry", "said"),
    [
        ({"flash": [1, 1, 1]}, "flash says how bright the flash of 'without_flash' is, and none is named"),
        ({"without_flash": "a.exr", "before": "b.exr"}, "without_flash leaves .* alone: leave out 'before'"),
        ({"without_flash": "a.exr", "environment": "b.hdr"}, "leave out 'environment'"),
        ({"without_flash": "a.exr", "light_group": "yard"}, "leave out 'light_group'"),
    ],
)
def test_keys_that_exclude_each_other_are_told(entry: dict[str, Any], said: str) -> None:
    with pytest.raises(ConfigError, match=said):
        read_manifest(manifest(**entry), "m.yaml")


def test_a_second_picture_that_does_not_fit_is_one_sentence(base: Path, tmp_path: Path) -> None:
    for name, said in (
        ("small.exr", "60 x 40 pixels and the other picture of its pair 120 x 80"),
        ("none.exr", "none"),
    ):
        with pytest.raises(ConfigError, match=said) as caught:
            import_pictures(read_manifest(manifest(before=name), "m.yaml"), tmp_path / "own", base=base)
        assert len(str(caught.value).splitlines()) == 1
        assert not (tmp_path / "own").exists()
