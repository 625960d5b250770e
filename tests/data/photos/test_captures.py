"""Cameras from files of COLMAP and NeRF: equal in all formats, exact on the picture, and refused in one sentence."""

from __future__ import annotations

import json
import math
import os
import re
import struct
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from camera_files import Taken, moved, nerf, take, write_colmap_binary, write_colmap_text, write_nerf
from PIL import Image, ImageDraw

from svbrdfgan.data.photos.alignment import Alignment
from svbrdfgan.data.photos.build import import_pictures
from svbrdfgan.data.photos.calibrated_camera import CalibratedCamera
from svbrdfgan.data.photos.captures import expand_captures
from svbrdfgan.data.photos.check import ErrorCollector
from svbrdfgan.data.photos.colmap import read_colmap
from svbrdfgan.data.photos.manifest import PictureEntry, read_manifest
from svbrdfgan.data.photos.rectify import rectified_camera, rectify
from svbrdfgan.errors import AssetError, ConfigError
from svbrdfgan.io.gltf.surface_files import save_mesh_glb
from svbrdfgan.procedural.kinds import sample_vehicle
from svbrdfgan.procedural.vehicle import build_vehicle
from svbrdfgan.types import Camera, Mesh

SIZE = (240, 160)
PICTURES = (
    take("a.png", 40, 25, SIZE, (300.0, 310.0, 131.0, 74.0, -0.21, 0.05, 0.004, -0.003)),
    take("sub/b.png", 130, -100, SIZE, (260.0, 260.0, 112.0, 90.0, 0.12, 0.0, 0.0, 0.0)),
    take("c.png", 300, 180, SIZE, (250.0, 250.0, 120.0, 80.0, 0.0, 0.0, 0.0, 0.0)),
)
"""Rolled, off-centre and distorted; the last is upside down alone."""


@pytest.fixture(scope="module")
def car() -> Mesh:
    return build_vehicle(sample_vehicle("van", 5))


@pytest.fixture
def base(car: Mesh, tmp_path: Path) -> Path:
    """The pictures, white where each camera sees the car, the masks alike, and the cameras in three formats."""
    save_mesh_glb(tmp_path / "car.glb", car)
    for one in PICTURES:
        seen = silhouette(one, car)
        for folder in ("images", "masks"):
            path = tmp_path / folder / one.name
            path.parent.mkdir(parents=True, exist_ok=True)
            seen.save(path)
    write_colmap_text(tmp_path / "text", PICTURES)
    write_colmap_binary(tmp_path / "binary", PICTURES)
    write_nerf(tmp_path / "transforms.json", PICTURES)
    return tmp_path


def silhouette(taken: Taken, mesh: Mesh) -> Image.Image:
    """The mesh as the camera sees it, 4 x 4 samples a pixel, by drawing its distorted triangles."""
    big = Image.new("L", (taken.size[0] * 4, taken.size[1] * 4))
    draw = ImageDraw.Draw(big)
    for corners in taken.pixels(mesh.positions)[mesh.faces] * 4 - 0.5:
        draw.polygon([(float(x), float(y)) for x, y in corners], fill=255)
    return big.resize(taken.size, Image.Resampling.BOX)


def capture(cameras: str, **changes: Any) -> dict[str, Any]:
    return {"cameras": cameras, "images": "images", "masks": "masks", "mesh": "car.glb", **changes}


def entries(base: Path, *captures: dict[str, Any]) -> tuple[PictureEntry, ...]:
    errors = ErrorCollector("m.yaml")
    manifest, labels = expand_captures(read_manifest({"captures": captures}, "m.yaml"), base, errors)
    errors.raise_if_any()
    assert labels == tuple(f"captures[{k}]" for k in range(len(captures)) for _ in PICTURES)
    return manifest.pictures


def calibrated(entry: PictureEntry) -> CalibratedCamera:
    assert isinstance(entry.camera, CalibratedCamera)
    return entry.camera


def pixels(camera: CalibratedCamera, points: np.ndarray) -> np.ndarray:
    film, _ = camera.film_coordinates(points)
    return (film * (1, -1) + 1) / 2 * camera.size


@pytest.mark.parametrize("cameras", ["text", "binary", "transforms.json"])
def test_every_format_projects_as_opencv_does(cameras: str, base: Path, car: Mesh) -> None:
    found = entries(base, capture(cameras))
    assert [(one.file, one.mask) for one in found] == [(f"images/{one.name}", f"masks/{one.name}") for one in PICTURES]
    for entry, taken in zip(found, PICTURES, strict=True):
        assert pixels(calibrated(entry), car.positions) == pytest.approx(taken.pixels(car.positions), abs=1e-6)


@pytest.mark.parametrize(
    ("model", "focal", "distortion"),
    [
        ("SIMPLE_PINHOLE 240 160 300 120 80", (300, 300), (0, 0, 0, 0)),
        ("PINHOLE 240 160 300 310 120 80", (300, 310), (0, 0, 0, 0)),
        ("SIMPLE_RADIAL 240 160 300 120 80 -0.1", (300, 300), (-0.1, 0, 0, 0)),
        ("RADIAL 240 160 300 120 80 -0.1 0.02", (300, 300), (-0.1, 0.02, 0, 0)),
    ],
)
def test_simpler_lens_models_of_colmap(
    model: str, focal: tuple[float, ...], distortion: tuple[float, ...], base: Path
) -> None:
    (base / "text" / "cameras.txt").write_text("".join(f"{number} {model}\n" for number in (1, 2, 3)))
    camera = calibrated(entries(base, capture("text"))[0])
    assert (camera.size, camera.focal, camera.center) == ((240, 160), focal, (120, 80))
    assert camera.distortion == distortion


def test_overlays_lie_on_the_pictures(base: Path) -> None:
    data = {"captures": [capture("binary")], "image": [32, 32], "texture": 16}
    records = import_pictures(read_manifest(data, "m.yaml"), base / "own", base=base, preview=True)
    assert [one.file for one in records] == [f"images/{one.name}" for one in PICTURES]
    for record in records:
        assert record.iou is not None
        assert record.iou > 0.985
        assert not [doubt for doubt in record.doubts if "enlarged" not in doubt]


def test_rectifying_moves_points_to_where_the_data_set_s_camera_sees_them(base: Path, car: Mesh) -> None:
    corners = np.stack(np.meshgrid(*car.bounds.T), axis=-1).reshape(-1, 3) * 0.7 + car.bounds.mean(axis=0) * 0.3
    film = (240, 240)
    columns, rows = np.meshgrid(np.arange(480) + 0.5, np.arange(320) + 0.5)
    for entry, taken in zip(entries(base, capture("text")), PICTURES, strict=True):
        target = rectified_camera(calibrated(entry), car, film).camera()
        expected = pixels(CalibratedCamera.of(target, film), corners)
        for (x, y), (to_x, to_y) in zip(taken.pixels(corners) * 2, expected, strict=True):  # a copy of twice the size
            dot = torch.from_numpy(np.exp(-((columns - x) ** 2 + (rows - y) ** 2) / 8)).float()[None]
            found = rectify(dot, calibrated(entry), target, film)[0].numpy()
            places = np.stack(np.meshgrid(np.arange(240) + 0.5, np.arange(240) + 0.5), axis=-1)
            assert np.einsum("ij,ijk->k", found, places) / found.sum() == pytest.approx([to_x, to_y], abs=0.1)


def test_a_ray_is_what_the_camera_projects_to_its_pixel(base: Path) -> None:
    for entry in entries(base, capture("text")):
        camera = calibrated(entry)
        for film in ((-1.0, -1.0), (0.0, 0.0), (0.3, 1.0)):
            point = np.asarray(camera.position) + 3 * camera.ray(np.array(film))
            assert camera.film_coordinates(point[None])[0][0] == pytest.approx(film, abs=1e-7)


def test_directions_that_distortion_would_fold_back_are_not_seen() -> None:
    camera = CalibratedCamera.of(Camera((0.0, 0.0, 3.0)), (100, 100)).model_copy(
        update={"distortion": (-0.3, 0.0, 0.0, 0.0)}
    )
    tangents = np.array([[0.2, 0.0, -1.0], [1.0, 0.0, -1.0], [1.06, 0.0, -1.0], [1.8, 0.0, -1.0], [0.0, 0.0, 1.0]])
    assert np.isnan(camera.project(tangents)[:, 0]).tolist() == [False, False, True, True, True]
    with pytest.raises(ConfigError, match="folds the picture over itself"):
        camera.model_copy(update={"distortion": (-4.0, 0.0, 0.0, 0.0)}).pinhole()


def test_the_crop_of_a_rolled_picture_is_level_and_as_large_as_fits(car: Mesh) -> None:
    taken = take("a.png", 40, 45, (200, 200), (900.0, 900.0, 100.0, 100.0, 0, 0, 0, 0))
    pose = taken.camera_to_world @ np.diag([1.0, -1.0, -1.0, 1.0])
    rows = tuple(tuple(row) for row in pose.tolist())
    camera = CalibratedCamera(camera_to_world=rows, size=(200, 200), focal=(900, 900), center=(100, 100))
    target = rectified_camera(camera, car, (64, 64)).camera()
    # a level square inside a square that is turned by 45 degrees
    assert math.tan(target.vertical_fov / 2) == pytest.approx(100 / 900 / math.sqrt(2), rel=0.02)
    assert rectify(torch.ones(1, 200, 200), camera, target, (64, 64)).min() > 0.9


def test_captures_in_any_axes_and_scale_are_aligned(base: Path, car: Mesh) -> None:
    """The world of the capture has the up axis -Y and the nose at +X, in decimetres; once with the mesh in it too."""
    alignment = {"up": [0, -1, 0], "nose": [2, 5, 0], "scale": 0.1}
    to_ours = read_alignment(alignment).array()
    assert to_ours[:3, :3] @ [10, 0, 0] == pytest.approx([0, 0, 1])
    assert to_ours[:3, :3] @ [0, -10, 0] == pytest.approx([0, 1, 0])
    write_colmap_text(base / "turned", [moved(one, to_ours) for one in PICTURES])
    inverse = np.linalg.inv(to_ours)
    save_mesh_glb(base / "turned.glb", replace(car, positions=car.positions @ inverse[:3, :3].T))
    captures = [
        capture("text"),
        capture("turned", alignment={"matrix": to_ours.tolist()}),
        capture("turned", alignment=alignment, align_mesh=True, mesh="turned.glb"),
    ]
    plain, own, both = np.split(np.array([calibrated(one).camera_to_world for one in entries(base, *captures)]), 3)
    assert own == pytest.approx(plain, abs=1e-9)
    assert both == pytest.approx(plain, abs=1e-9)
    data = {"captures": captures[2:], "image": [32, 32], "texture": 16}
    records = import_pictures(read_manifest(data, "m.yaml"), base / "own", base=base, preview=True)
    assert min(one.iou or 0 for one in records) > 0.985


def read_alignment(data: dict[str, Any]) -> Alignment:
    return read_manifest({"captures": [capture("text", alignment=data)]}, "m.yaml").captures[0].alignment


def test_nerf_s_shorter_forms(base: Path) -> None:
    """`camera_angle_x` without a size, names without suffixes, masks by frame; and OpenCV's axes."""
    taken = take("images/c", 300, 180, SIZE, (250.0, 250.0, 120.0, 80.0, 0, 0, 0, 0))
    (full,) = nerf([taken])["frames"]
    frame = {"file_path": "./images/c", "transform_matrix": full["transform_matrix"], "mask_path": "masks/c.png"}
    short = {"camera_angle_x": 2 * math.atan(120 / 250), "frames": [frame]}
    like = {"file": "images/c.png", "mask": "masks/c.png", "camera_to_world": taken.camera_to_world.tolist()}
    pinhole = {"model": "PINHOLE", "width": 240, "height": 160, "focal": 250.0, "cx": 120.0, "cy": 80.0}
    (base / "short.json").write_text(json.dumps(short))
    (base / "like.json").write_text(json.dumps({**pinhole, "frames": [like]}))
    found = []
    for name in ("short.json", "like.json"):
        manifest = read_manifest({"captures": [{"cameras": name, "mesh": "car.glb"}]}, "m.yaml")
        errors = ErrorCollector("m.yaml")
        found += expand_captures(manifest, base, errors)[0].pictures
        errors.raise_if_any()
    assert [(one.file, one.mask) for one in found] == [("images/c.png", "masks/c.png")] * 2
    wanted = taken.pixels(np.zeros((1, 3)))
    for one in found:
        assert pixels(calibrated(one), np.zeros((1, 3))) == pytest.approx(wanted, abs=1e-9)


def test_pictures_without_a_camera_are_left_out_with_a_warning(base: Path, caplog: pytest.LogCaptureFixture) -> None:
    Image.new("RGB", SIZE).save(base / "images" / "lost.jpg")
    assert len(entries(base, capture("text"))) == 3
    assert "text has no camera of 1 pictures, which are left out: lost.jpg" in caplog.text


Change = Callable[[dict[str, Any]], object]
TINY: dict[str, Any] = {"image": [16, 16], "texture": 16}


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda d: d.pop("frames"), ".*has no list 'frames'"),
        (lambda d: d["frames"].clear(), ".*transforms.json has no picture"),
        (lambda d: d["frames"][1].pop("file_path"), r"transforms.json: frames\[1\] names no picture"),
        (lambda d: d["frames"].append(d["frames"][0]), ".*has several cameras of a.png; keep one"),
        (lambda d: d["frames"][0].update(file_path="z.png"), "z.png: .*z.png does not exist; delete its frame"),
        (
            lambda d: d["frames"][0].update(file_path="unmasked.png"),
            ".*masks/unmasked.png does not exist; wanted a mask",
        ),
        (lambda d: d.update(k3=0.1), ".*the lens model is a fisheye, or has k3 or k4"),
        (lambda d: d.update(camera_model="OPENCV_FISHEYE"), ".*the lens model is a fisheye"),
        (lambda d: d.pop("fl_x"), ".*neither 'fl_x' nor 'camera_angle_x'"),
        (lambda d: d.update(fl_x="wide"), ".*fl_x: 'wide' is not allowed; wanted a number"),
        (lambda d: d["frames"][0].pop("transform_matrix"), ".*key 'transform_matrix' is missing"),
        (
            lambda d: d["frames"][0]["transform_matrix"][1].__setitem__(3, math.nan),
            ".*nan is not allowed; wanted a finite",
        ),
        (lambda d: d["frames"][0]["transform_matrix"][1].__setitem__(0, 4.0), ".*wanted a 4 x 4 matrix of rotation"),
        (lambda d: d["frames"][0].update(transform_matrix=np.diag([2.0, 2, 2, 1]).tolist()), ".*it scales by 2;"),
        (
            lambda d: d.update(w=160),
            "a.png: it is 240 x 160 pixels when upright, and its camera's pictures are 160 x 160",
        ),
        (
            lambda d: d["frames"][0].update(transform_matrix=np.eye(4).tolist()),
            ".*the camera does not have all of the mesh in front of it",
        ),
        (lambda d: d.update(k1=-9.0), r".*the distortion \(-9.0, 0.05, 0.004, -0.003\) folds the picture"),
    ],
)
def test_what_is_wrong_in_transforms_is_one_line(
    change: Change, said: str, base: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """An error, or a warning where the other picture can be used."""
    Image.new("RGB", SIZE).save(base / "images" / "unmasked.png")
    data = nerf(PICTURES)
    change(data)
    (base / "transforms.json").write_text(json.dumps(data))
    contents = read_manifest({"captures": [capture("transforms.json")], **TINY}, "m.yaml")
    try:
        import_pictures(contents, base / "own", base=base, source="m.yaml", preview=True)
        line = next(said for said in caplog.messages if said.startswith("m.yaml"))
        assert re.match(r"\d of \d pictures are left out", caplog.messages[-1])
    except ConfigError as error:
        line = str(error).splitlines()[0]
    assert re.match(rf"m.yaml: captures\[0\]: (images/|\./)?{said}", line), line


def test_of_many_errors_the_first_are_listed() -> None:
    collector = ErrorCollector("m.yaml", [f"m.yaml: error {number}" for number in range(50)])
    with pytest.raises(ConfigError) as caught:
        collector.raise_if_any()
    assert str(caught.value).splitlines()[-2:] == ["m.yaml: error 29", "m.yaml: and 20 further errors."]


def errors(base: Path, *captures: dict[str, Any]) -> list[str]:
    with pytest.raises(ConfigError) as caught:
        import_pictures(
            read_manifest({"captures": captures, **TINY}, "m.yaml"),
            base / "own",
            base=base,
            source="m.yaml",
            preview=True,
        )
    assert not (base / "own").exists()
    return str(caught.value).splitlines()


@pytest.mark.parametrize(
    ("file", "content", "said"),
    [
        (
            "cameras.txt",
            "1 OPENCV_FISHEYE 240 160 9 9 9 9 0 0 0 0",
            ".*camera 1 has the lens model OPENCV_FISHEYE; known",
        ),
        ("cameras.txt", "1 PINHOLE 240 160 9 9 9", ".*camera 1 has 3 parameters; PINHOLE has 4"),
        ("cameras.txt", "1 PINHOLE wide", ".*cameras.txt is not a file of COLMAP, or is cut off"),
        ("cameras.txt", "9 PINHOLE 240 160 9 9 9 9", ".*has no camera 1, which a.png is taken with"),
        ("images.txt", "# none", ".*text has no picture"),
        ("images.txt", "8 0 0 0 0 0 0 0 1 a.png", r".*camera_to_world\[0\]\[0\]: nan is not allowed"),
        ("images.txt", "8 1 0 0 0 0 0 1 a.png", ".*images.txt is not a file of COLMAP, or is cut off"),
        ("images.txt", "8 1 0 0 0 0 0 0 1 /", ".*text has a picture called '/', which no file can be"),
        ("images.txt", f"8 1 0 0 0 0 0 0 1 {'a' * 300}.png", ".*text has a picture called 'aaa"),
        (
            "images.bin",
            struct.pack("<QI7dI", 2, 8, 1, *[0] * 6, 1) + b"a.png\0" + struct.pack("<Q", 2**63),
            ".*images.bin is not a file of COLMAP, or is cut off",
        ),
        ("images.bin", struct.pack("<QI", 3, 8), ".*images.bin is not a file of COLMAP, or is cut off"),
        (
            "cameras.bin",
            struct.pack("<QiiQQ", 1, 1, 10, 9, 9) + bytes(96),
            ".*camera 1 has the lens model number 10; known are SIMPLE_PINHOLE",
        ),
    ],
)
def test_what_is_wrong_in_a_model_of_colmap_is_one_line(file: str, content: str | bytes, said: str, base: Path) -> None:
    folder = "binary" if file.endswith("bin") else "text"
    (base / folder / file).write_bytes(content if isinstance(content, bytes) else content.encode())
    line = errors(base, capture(folder))[0]
    assert re.match(rf"m.yaml: captures\[0\]: {said}", line), line


def test_a_pipe_in_place_of_a_model_is_not_waited_for(tmp_path: Path) -> None:
    for name in ("cameras.bin", "images.bin"):
        os.mkfifo(tmp_path / name)
    with pytest.raises(AssetError, match="holds no COLMAP model"):
        read_colmap(tmp_path)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"cameras": "sparse/0"}, "sparse/0 holds no COLMAP model: wanted cameras.bin and images.bin, or"),
        ({"images": None}, "key 'images' is missing"),
        ({"cameras": "none.json"}, "none.json cannot be read: No such file"),
    ],
)
def test_what_is_wrong_in_a_capture_is_one_line(changes: dict[str, Any], said: str, base: Path) -> None:
    (line,) = errors(base, {**capture("text"), **changes})
    assert line.startswith("m.yaml: captures[0]: ")
    assert said in line


@pytest.mark.parametrize(
    ("alignment", "said"),
    [
        ({"up": [0, 0, 1]}, "'nose' is parallel to 'up'"),
        ({"up": [0, 0, 0]}, "must be directions, not zero"),
        ({"matrix": np.diag([1.0, 1, -1, 1]).tolist()}, "wanted a 4 x 4 matrix of rotation, uniform scale"),
        ({"matrix": np.diag([1.0, 1, 1, 2]).tolist()}, "wanted a 4 x 4 matrix of rotation, uniform scale"),
        ({"matrix": np.eye(4).tolist(), "scale": 2.0}, "'matrix' stands instead of"),
        ({"matrix": np.eye(3).tolist()}, "wanted more values"),
        ({"scale": 0.0}, "wanted a number above 0"),
    ],
)
def test_what_is_wrong_in_an_alignment_is_said(alignment: dict[str, Any], said: str) -> None:
    with pytest.raises(ConfigError, match=said):
        read_alignment(alignment)


def test_a_mesh_is_aligned_in_one_way() -> None:
    data = {"captures": [capture("text"), capture("text", align_mesh=True, alignment={"scale": 2.0})]}
    with pytest.raises(ConfigError, match=r"captures align 'car\.glb' in different ways"):
        read_manifest(data, "m.yaml")


def test_a_picture_may_have_a_calibrated_camera_of_its_own(base: Path) -> None:
    entry = entries(base, capture("text"))[0]
    data = {"image": [32, 32], "texture": 16, "pictures": [json.loads(entry.model_dump_json())]}
    (record,) = import_pictures(read_manifest(data, "m.yaml"), base / "own", base=base, preview=True)
    assert record.iou is not None
    assert record.iou > 0.985
