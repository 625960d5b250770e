"""The parts of importing pictures, each against what is known by construction."""

from __future__ import annotations

import math
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from PIL import Image
from torch import Tensor

from svbrdfgan.config.distributions import Fixed
from svbrdfgan.data.index import DatasetIndex
from svbrdfgan.data.photos.calibrated_camera import CalibratedCamera
from svbrdfgan.data.photos.exposure import exposure_factor, mean_light
from svbrdfgan.data.photos.overlay import NO_PART, intersection_over_union, visible_parts
from svbrdfgan.data.photos.photo import load_photo, photo_size
from svbrdfgan.data.photos.rectify import minification, rectified_camera, rectify
from svbrdfgan.data.sampler import ConfigSampler
from svbrdfgan.errors import AssetError, ConfigError
from svbrdfgan.io.environment import load_environment
from svbrdfgan.io.exr import save_exr
from svbrdfgan.io.image import linear_from_srgb
from svbrdfgan.plugins.registry import load_embedding, load_renderer
from svbrdfgan.procedural.kinds import sample_vehicle
from svbrdfgan.procedural.vehicle import build_vehicle
from svbrdfgan.types import Camera, Environment, Material, Materials, Mesh, Part, Rendering, View


@pytest.fixture(scope="module")
def car() -> Mesh:
    return build_vehicle(sample_vehicle("van", 5))


def orbit(azimuth: float = 40, elevation: float = 15, distance: float = 2.2, fov: float = 34) -> Camera:
    return Camera.orbit(math.radians(azimuth), math.radians(elevation), distance, (0.1, 0.2, -0.1), math.radians(fov))


def seen_all_round(camera: Camera, width: int, height: int) -> Tensor:
    """A smooth pattern on the sky, three channels, as the camera sees it at its pixels' centres."""
    up = math.tan(camera.vertical_fov / 2)
    y, x = np.meshgrid(
        (1 - (np.arange(height) + 0.5) / height * 2) * up,
        ((np.arange(width) + 0.5) / width * 2 - 1) * up * width / height,
        indexing="ij",
    )
    sight = np.stack([x, y, -np.ones_like(x)], axis=-1)
    sight = sight / np.linalg.norm(sight, axis=-1, keepdims=True) @ camera.basis()
    return torch.from_numpy(np.sin(5 * sight + [0, 1, 2])).float().permute(2, 0, 1)


def test_rectifying_gives_the_picture_of_another_direction() -> None:
    source = orbit(fov=60)
    target = Camera(source.origin, (0.3, 0.4, 0.2), vertical_fov=math.radians(20))
    found = rectify(seen_all_round(source, 480, 320), CalibratedCamera.of(source, (480, 320)), target, (48, 32))
    assert (found - seen_all_round(target, 48, 32)).abs().max() < 0.004


def test_beyond_the_border_there_is_nothing() -> None:
    source = orbit(fov=30)
    away = Camera(source.origin, tuple(2 * np.asarray(source.origin)), vertical_fov=math.radians(20))  # type: ignore[arg-type]
    assert not rectify(torch.ones(1, 32, 48), CalibratedCamera.of(source, (48, 32)), away, (8, 8)).any()
    wider = Camera(source.origin, source.target, vertical_fov=2 * math.atan(2 * math.tan(math.radians(15))))
    seen = rectify(torch.ones(1, 64, 64), CalibratedCamera.of(source, (64, 64)), wider, (16, 16))[0]
    assert seen[4:12, 4:12].min() > 0.99
    assert float(seen.mean()) == pytest.approx(0.25, abs=0.01)


@pytest.mark.parametrize("film", [(64, 64), (96, 48)])
def test_the_rectified_camera_shows_the_whole_mesh_from_the_same_place(car: Mesh, film: tuple[int, int]) -> None:
    for azimuth in range(0, 360, 45):
        source = orbit(azimuth)
        target = rectified_camera(CalibratedCamera.of(source, (150, 100)), car, film)
        assert target.camera().origin == pytest.approx(source.origin)
        assert target.target == pytest.approx(tuple(car.bounds.mean(axis=0)))
        at, _ = CalibratedCamera.of(target.camera(), film).film_coordinates(car.positions)
        assert np.abs(at).max() == pytest.approx(1 / 1.08)


def test_a_mesh_that_reaches_beyond_the_picture_is_cropped_about_its_middle(car: Mesh) -> None:
    source = orbit(distance=1.0, fov=30)
    target = rectified_camera(CalibratedCamera.of(source, (150, 100)), car, (64, 64)).camera()
    assert target.origin == pytest.approx(source.origin)
    assert target.basis() == pytest.approx(source.basis())
    assert target.vertical_fov == pytest.approx(source.vertical_fov)  # a square of the picture's height
    upright = rectified_camera(CalibratedCamera.of(source, (100, 150)), car, (64, 64)).camera()
    assert math.tan(upright.vertical_fov / 2) == pytest.approx(math.tan(source.vertical_fov / 2) / 1.5)


@pytest.mark.parametrize(
    ("camera", "message"),
    [
        (Camera((0.0, 0.2, 3.0), (0.0, 0.2, 6.0)), "does not have all of the mesh in front"),
        (Camera((0.0, 0.2, 0.0), (0.0, 0.2, 6.0)), "does not have all of the mesh in front"),
        (Camera((0.0, 0.2, 3.0), (4.0, 0.2, 0.0), vertical_fov=0.3), "does not see the mesh"),
    ],
)
def test_impossible_cameras_are_refused(camera: Camera, message: str, car: Mesh) -> None:
    with pytest.raises(ConfigError, match=message):
        rectified_camera(CalibratedCamera.of(camera, (150, 100)), car, (64, 64))


def test_minification_is_source_pixels_along_a_target_pixel() -> None:
    source = CalibratedCamera.of(orbit(fov=40), (150, 100))
    assert minification(300, source, orbit(fov=40), (64, 100)) == pytest.approx(3)


def test_the_silhouette_is_the_renderer_s(car: Mesh) -> None:
    camera = orbit()
    surface = load_embedding("hemispherical", {"resolution": 32}).embed(car)
    renderer = load_renderer("numpy", {})
    materials = Materials((Material.lambertian((0.5, 0.5, 0.5)),) * len(surface.parts))
    view = View(camera, Environment(torch.ones(4, 8, 3)), 48, 32)
    coverage = renderer.render(renderer.prepare(surface), materials, view, spp=16, seed=1).coverage
    parts = visible_parts(car, camera, 48 * 8, 32 * 8)
    silhouette = torch.from_numpy((parts != NO_PART).reshape(32, 8, 48, 8).mean(axis=(1, 3)))
    assert (silhouette - coverage).abs().mean() < 0.01
    assert float((silhouette - coverage).mean()) == pytest.approx(0, abs=0.002)


def test_the_nearer_part_is_seen() -> None:
    """Two squares that cross in depth at the line of sight: each hides the other on one side."""
    x = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]], dtype=float)
    positions = np.concatenate([np.column_stack([x, slope * x[:, 0]]) for slope in (0.5, -0.5)])
    faces = np.array([[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]])
    mesh = Mesh(positions, faces, np.array([0, 0, 1, 1]), (Part("rises"), Part("falls")))
    parts = visible_parts(mesh, Camera((0.0, 0.0, 4.0), vertical_fov=math.radians(40)), 64, 64)
    assert set(parts[20:44, 36:44].ravel()) == {0}
    assert set(parts[20:44, 20:28].ravel()) == {1}
    assert parts[0, 0] == NO_PART


def test_agreement_is_intersection_over_union() -> None:
    one, other = np.zeros((2, 4), dtype=bool), np.zeros((2, 4), dtype=bool)
    one[0], other[:, :2] = True, True
    assert intersection_over_union(one, other) == pytest.approx(2 / 6)
    assert intersection_over_union(one, one) == 1
    assert intersection_over_union(np.zeros_like(one), np.zeros_like(one)) == 0


def rendering(values: Tensor) -> Rendering:
    return Rendering(values[..., None].expand(*values.shape, 3), torch.ones(values.shape))


def test_exposure_undoes_any_gain_and_is_not_moved_by_the_weathered_third() -> None:
    clean = torch.rand(30, 30, generator=torch.manual_seed(0)) + 0.1
    weathered = clean.clone()
    weathered[:10] *= 12
    for gain in (0.01, 1.0, 50.0):
        assert exposure_factor(rendering(clean * gain), rendering(clean)) * gain == pytest.approx(1, rel=1e-5)
        assert exposure_factor(rendering(weathered * gain), rendering(clean)) * gain == pytest.approx(1, rel=1e-5)


def test_an_impossible_exposure_is_refused() -> None:
    clean = rendering(torch.ones(4, 4))
    with pytest.raises(AssetError, match="black"):
        exposure_factor(rendering(torch.zeros(4, 4)), clean)
    with pytest.raises(AssetError, match="no pixel in common"):
        exposure_factor(Rendering(clean.image, torch.zeros(4, 4)), clean)


def test_the_mean_light_is_what_a_fixed_turn_makes_of_the_maps(tiny_dataset: Path) -> None:
    sampler = DatasetIndex.load(tiny_dataset).sampler("train")
    maps = [load_environment(tiny_dataset / light.asset.path) * light.normalisation for light in sampler.environments]

    def light(degrees: float) -> Tensor:
        changed = sampler.config.model_copy(
            update={
                "environment_rotation_degrees": Fixed[float](fixed=degrees),
                "environment_brightness": Fixed[float](fixed=2.0),
            }
        )
        one = ConfigSampler(changed, "train", sampler.meshes, sampler.environments[:1])
        return mean_light(one, tiny_dataset)

    still, turned = light(0), light(90)
    assert torch.allclose(still[::2, ::2], 2 * maps[0], rtol=1e-4, atol=1e-6)  # from 16 rows to 32
    # A light at +X (u = 0.75) moves to -Z (u = 0.5), as conventions.md says.
    assert torch.allclose(turned[:, 32], still[:, 48], rtol=1e-4)
    random = mean_light(sampler, tiny_dataset)
    assert float(random.std(dim=1).mean() / random.mean()) < 0.3 * float(still.std(dim=1).mean() / still.mean())


SaveImage = Callable[[str, Any], Path]


@pytest.fixture
def saved(tmp_path: Path) -> SaveImage:
    def save(name: str, array: Any, **options: Any) -> Path:
        Image.fromarray(np.asarray(array, dtype=np.uint8)).save(tmp_path / name, **options)
        return tmp_path / name

    return save  # type: ignore[return-value]


def test_eight_bits_are_srgb_and_exr_is_linear(saved: SaveImage, tmp_path: Path) -> None:
    photo = load_photo(saved("a.png", np.full((16, 20, 3), 128)), None)
    assert photo.size == (20, 16)
    assert float(photo.image[3, 4, 1]) == pytest.approx(float(linear_from_srgb(torch.tensor(128 / 255))))
    assert photo.mask is None
    save_exr(tmp_path / "a.exr", dict.fromkeys("RGB", torch.full((16, 20), 3.5)))
    assert float(load_photo(tmp_path / "a.exr", None).image.mean()) == 3.5


def test_exif_turns_a_picture_upright(tmp_path: Path) -> None:
    pixels = np.zeros((16, 32, 3), dtype=np.uint8)
    pixels[:, :8] = 255
    image = Image.fromarray(pixels)
    exif = image.getexif()
    exif[0x0112] = 6  # the first row is the right-hand side
    image.save(tmp_path / "turned.jpg", exif=exif, quality=95)
    photo = load_photo(tmp_path / "turned.jpg", None)
    assert photo.size == (16, 32)
    assert photo.image[:6].mean() > 0.9 > 0.1 > photo.image[-6:].mean()


def test_pictures_of_many_pixels_are_reduced(saved: SaveImage, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """They keep their colours, and are turned upright; their size in the file is told as it is."""
    pixels = np.zeros((60, 120, 3), dtype=np.uint8)
    pixels[:, :60] = 255
    image = Image.fromarray(pixels)
    exif = image.getexif()
    exif[0x0112] = 6
    image.save(tmp_path / "large.jpg", exif=exif, quality=95)
    monkeypatch.setattr("svbrdfgan.data.photos.photo._KEPT_PIXELS", 1000)
    photo = load_photo(tmp_path / "large.jpg", saved("mask.png", np.full((120, 60), 255)))
    assert photo.size == (20, 40)
    assert photo.mask is not None
    assert photo.image[:18].mean() > 0.9 > 0.1 > photo.image[22:].mean()
    assert photo_size(tmp_path / "large.jpg") == (60, 120)
    cut = np.full((60, 120, 4), 128)
    cut[:, :60, 3] = 0
    own = load_photo(saved("cut.png", cut), None)
    assert own.mask is not None
    assert own.mask.shape == (20, 40)
    monkeypatch.setattr("svbrdfgan.data.photos.photo.MOST_PIXELS", 7000)
    with pytest.raises(AssetError, match="has 0 megapixels; at most 0 are read: make it smaller"):
        load_photo(tmp_path / "large.jpg", None)


def test_a_png_of_more_pixels_than_its_bytes_can_hold_is_not_decoded(tmp_path: Path) -> None:
    plain = tmp_path / "plain.png"
    Image.new("1", (4096, 4096)).save(plain)
    assert load_photo(plain, None).size == (4096, 4096)
    head = plain.read_bytes()[:33]
    size = (16_000).to_bytes(4, "big")
    claimed = head[12:16] + size + size + head[24:29]
    (tmp_path / "claims.png").write_bytes(
        head[:12] + claimed + zlib.crc32(claimed).to_bytes(4, "big") + plain.read_bytes()[33:]
    )
    with pytest.raises(AssetError, match="says that it has 16000 x 16000 pixels, which its bytes cannot hold"):
        load_photo(tmp_path / "claims.png", None)


@pytest.mark.full
def test_a_phone_s_200_megapixels_are_read(tmp_path: Path) -> None:
    Image.new("RGB", (16_384, 12_288), (90, 80, 70)).save(tmp_path / "phone.jpg")
    photo = load_photo(tmp_path / "phone.jpg", None)
    assert photo.size == (5462, 4096)
    assert photo_size(tmp_path / "phone.jpg") == (16_384, 12_288)
    Image.new("1", (20_000, 20_000)).save(tmp_path / "bomb.png")
    with pytest.raises(AssetError, match="has 400 megapixels; at most 300 are read"):
        load_photo(tmp_path / "bomb.png", None)


def test_masks_are_plain_numbers_and_transparency_is_one(saved: SaveImage, tmp_path: Path) -> None:
    picture = saved("a.png", np.full((16, 20, 3), 128))
    photo = load_photo(picture, saved("mask.png", np.full((16, 20), 200)))
    assert photo.mask is not None
    assert float(photo.mask.mean()) == pytest.approx(200 / 255, abs=1e-5)
    cut = np.full((16, 20, 4), 128)
    cut[:, :10, 3], cut[:, 10:, 3] = 255, 0
    own = load_photo(saved("cut.png", cut), None)
    assert own.mask is not None
    assert own.mask[:, :10].min() == 1
    assert own.mask[:, 10:].max() == 0
    premultiplied = {**dict.fromkeys("RGB", torch.full((16, 20), 0.3)), "A": torch.full((16, 20), 0.6)}
    save_exr(tmp_path / "cut.exr", premultiplied)
    assert float(load_photo(tmp_path / "cut.exr", None).image.mean()) == pytest.approx(0.5)


def test_unusable_pictures_are_refused(saved: SaveImage, tmp_path: Path) -> None:
    picture = saved("a.png", np.full((16, 20, 3), 128))
    (tmp_path / "broken.jpg").write_bytes(b"not a picture")
    holed = torch.ones(16, 20)
    holed[3, 4] = float("nan")
    save_exr(tmp_path / "holed.exr", dict.fromkeys("RGB", holed))
    wrong: list[tuple[Path, Path | None, str]] = [
        (tmp_path / "none.png", None, "does not exist"),
        (tmp_path / "broken.jpg", None, "cannot be read"),
        (tmp_path / "holed.exr", None, "not finite"),
        (saved("a.tif", np.full((16, 20, 3), 128)), None, "wanted one of"),
        (saved("dot.png", np.full((4, 4, 3), 128)), None, "at least 16 x 16"),
        (picture, saved("mask.png", np.full((16, 10), 255)), "10 x 16 pixels and its picture a.png 20 x 16"),
        (picture, saved("black.png", np.zeros((16, 20))), "masks everything away"),
    ]
    for path, mask, message in wrong:
        with pytest.raises(AssetError, match=message):
            load_photo(path, mask)
