"""Cameras by COLMAP: a model that the importer reads, of the object alone, and one sentence for what cannot be."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from PIL import Image
from scipy.ndimage import map_coordinates
from scipy.spatial.transform import Rotation

from svbrdfgan.data.photos import pose
from svbrdfgan.data.photos.colmap import read_colmap
from svbrdfgan.data.photos.pose import pose_pictures
from svbrdfgan.errors import AssetError, ConfigError, SvbrdfganError

SIZE, FOCAL = (240, 200), 330.0
TURNED = "sub/3.png"


@pytest.fixture
def images(tmp_path: Path) -> Path:
    """Three grey pictures."""
    folder = tmp_path / "images"
    folder.mkdir()
    for name in ("a.png", "b.jpg", "c.png"):
        Image.new("RGB", (32, 24), (120, 120, 120)).save(folder / name)
    return folder


@pytest.fixture
def no_models(monkeypatch: pytest.MonkeyPatch) -> None:
    """A COLMAP that places nothing."""
    monkeypatch.setattr(pose, "_library", lambda: ModuleType("pycolmap"))
    monkeypatch.setattr(pose, "_models", lambda *_: [])


def refused(images: Path, kind: type[SvbrdfganError], masks: Path | None = None) -> str:
    """Why the pictures are refused; nothing is written then."""
    before = sorted(images.parent.rglob("*"))
    with pytest.raises(kind) as error:
        pose_pictures(images, images.parent / "sparse", masks)
    assert sorted(images.parent.rglob("*")) == before
    return str(error.value)


def test_the_package_must_be_there(images: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "pycolmap", None)
    assert refused(images, ConfigError).endswith("is not installed; pip install 'svbrdfgan[colmap]'.")


def test_there_must_be_three_pictures(images: Path) -> None:
    (images / "c.png").unlink()
    (images / "c.txt").write_text("no picture")
    assert "images holds too few pictures: 2 PNG or JPEG files; wanted at least 3" in refused(images, ConfigError)
    assert "too few pictures: 0 " in refused(images.with_name("nowhere"), ConfigError)


def test_masks_are_no_pictures(images: Path) -> None:
    (images / "masks").mkdir()
    (images / "c.png").rename(images / "masks" / "c.png")
    assert "too few pictures: 2 " in refused(images, ConfigError, masks=images / "masks")


def test_the_folder_to_write_must_be_empty(images: Path) -> None:
    (images.parent / "sparse").mkdir()
    (images.parent / "sparse" / "cameras.bin").touch()
    assert "sparse already exists and is not empty" in refused(images, ConfigError)


@pytest.mark.usefixtures("no_models")
def test_every_picture_needs_a_mask_of_its_size(images: Path, tmp_path: Path) -> None:
    masks = tmp_path / "masks"
    masks.mkdir()
    Image.new("L", (32, 24), 255).save(masks / "a.png")
    Image.new("L", (16, 24), 255).save(masks / "b.jpg.png")
    first, second = refused(images, ConfigError, masks).splitlines()
    assert "b.jpg.png is 16 x 24 pixels and its picture b.jpg 32 x 24" in first
    assert "c.png does not exist; wanted a mask of each picture" in second


@pytest.mark.usefixtures("no_models")
def test_a_broken_picture_is_named(images: Path) -> None:
    (images / "b.jpg").write_bytes(b"broken")
    assert "b.jpg cannot be read as a picture" in refused(images, ConfigError)


@pytest.mark.usefixtures("no_models")
def test_nothing_may_be_placed(images: Path) -> None:
    assert "COLMAP could place no picture of" in refused(images, AssetError)


def take_globe(folder: Path, angles: Sequence[float]) -> dict[str, np.ndarray]:
    """Pictures of a globe of noise, and its masks, by cameras at these angles around it: by name, where they stand.

    The background is noise that stands still in the picture, as behind a turntable. One picture is turned by EXIF.
    """
    random, centers = np.random.default_rng(1), {}
    noise = sum(np.kron(random.random((96 // n,) * 3), np.ones((n,) * 3)) for n in (2, 4, 8))
    background = np.kron(random.random((SIZE[1] // 4, SIZE[0] // 4)), np.ones((4, 4)))
    x, y = np.meshgrid(np.arange(SIZE[0]) + 0.5 - SIZE[0] / 2, np.arange(SIZE[1]) + 0.5 - SIZE[1] / 2)
    for number, angle in enumerate(angles):
        name = TURNED if number == 3 else f"{number}.png"
        basis = Rotation.from_euler("YX", [angle, -20], degrees=True).as_matrix()
        centers[name] = 4 * basis[:, 2]
        rays = np.stack([x, -y, np.full_like(x, -FOCAL)], axis=-1) @ basis.T
        rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
        along = rays @ centers[name]
        inside = along**2 - 15
        points = centers[name] + rays * (-along - np.sqrt(inside.clip(0)))[..., None]
        seen = map_coordinates(noise, (points.transpose(2, 0, 1) + 1) * 47.5, order=1, mode="nearest")
        picture = np.where(inside > 0, seen / seen.max(), background)
        shots = {
            "images": Image.fromarray(np.uint8(255 * picture)),
            "masks": Image.fromarray(np.uint8(255 * (inside > 0))),
        }
        for kind, shot in shots.items():
            path = folder / kind / name
            path.parent.mkdir(parents=True, exist_ok=True)
            exif = Image.Exif()
            if name == TURNED:
                shot, exif[0x0112] = shot.transpose(Image.Transpose.ROTATE_90), 6
            shot.convert("RGB" if kind == "images" else "L").save(path, exif=exif)
    return centers


@pytest.mark.full
def test_cameras_are_found_around_an_object_before_a_background_that_stands_still(tmp_path: Path) -> None:
    if "colmap" not in os.environ.get("SVBRDFGAN_REQUIRED_TOOLS", "").split():
        pytest.importorskip("pycolmap")
    truth = take_globe(tmp_path, range(0, 80, 8))
    Image.new("RGB", SIZE, (90, 90, 90)).save(tmp_path / "images" / "z.png")
    Image.new("L", SIZE, 255).save(tmp_path / "masks" / "z.png")
    posed = pose_pictures(tmp_path / "images", tmp_path / "sparse", tmp_path / "masks")
    assert (posed.placed, posed.others) == (tuple(sorted(truth)), ("z.png",))
    assert posed.error < 1
    cameras = {frame.name: frame.camera(Path(frame.name)) for frame in read_colmap(tmp_path / "sparse")}
    assert all(camera["size"] == [*SIZE] for camera in cameras.values())
    found = np.array([np.array(cameras[name]["camera_to_world"])[:3, 3] for name in truth])
    wanted = np.array([*truth.values()])
    found, wanted = found - found.mean(axis=0), wanted - wanted.mean(axis=0)
    turn, _ = Rotation.align_vectors(wanted, found)
    scale = np.linalg.norm(wanted) / np.linalg.norm(found)
    assert scale * turn.apply(found) == pytest.approx(wanted, abs=0.04)
    assert turn.as_matrix()[1, 1] > np.cos(np.radians(2))
