"""Windows: the squares of fine maps that close-ups show."""

from __future__ import annotations

import shutil
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from safetensors import safe_open

from svbrdfgan.config.models import validate
from svbrdfgan.data.config import DatasetConfig
from svbrdfgan.data.generate import render_scene
from svbrdfgan.errors import AssetError, ConfigError
from svbrdfgan.geometry.camera_hits import camera_hits
from svbrdfgan.io.environment import save_environment
from svbrdfgan.rendering.checked_renderer import CheckedRenderer
from svbrdfgan.scene.cache import load_subject
from svbrdfgan.scene.description import Scene
from svbrdfgan.scene.loader import SceneLoader, subject_key
from svbrdfgan.scene.window import Window, bordered, find_window, windowed
from svbrdfgan.types import Camera, Layer, Part, Surface

SIZE, TEXTURE = 64, 256
FILM = 64


@pytest.fixture
def scene(tmp_path: Path, van: Path) -> Scene:
    """A close-up of a van's side, of which the window shows a part."""
    shutil.copyfile(van, tmp_path / "van.glb")
    save_environment(tmp_path / "grey.exr", torch.ones(8, 16, 3))
    return Scene.model_validate(
        {
            "mesh": {"path": "van.glb"},
            "environment": {"asset": {"path": "grey.exr"}},
            "camera": {
                "azimuth_degrees": 80.0,
                "elevation_degrees": 10.0,
                "distance": 0.45,
                "target": (0.2, 0.17, 0.0),
            },
            "width": FILM,
            "height": FILM,
            "texture": TEXTURE,
            "window": SIZE,
            "maps": {"roughness": 0.4},
            "weathering": {"recipe": "rust", "amount": 1.0, "seed": 3},
        }
    )


@pytest.fixture
def whole(scene: Scene) -> Scene:
    return scene.model_copy(update={"window": None})


def place_of(loader: SceneLoader, scene: Scene) -> tuple[slice, slice]:
    """Rows and columns of a scene's window."""
    subject = loader.subject(scene.model_copy(update={"window": None}))
    window = find_window(subject.surface, subject.learnable, scene.camera.camera(), 1.0, SIZE, TEXTURE)
    return slice(window.row, window.row + SIZE), slice(window.col, window.col + SIZE)


def test_a_window_has_the_texels_of_the_whole_map(scene: Scene, whole: Scene, tmp_path: Path) -> None:
    loader = SceneLoader(tmp_path)
    window, full, place = loader.subject(scene), loader.subject(whole), place_of(loader, scene)
    assert window.learnable == full.learnable
    assert torch.equal(window.buffer.part, full.buffer.part[place])
    seen = window.buffer.mask
    assert torch.equal(seen, full.buffer.mask[place])
    assert seen.float().mean() > 0.5
    for name in ("position", "normal"):
        own, other = getattr(window.buffer, name)[seen], getattr(full.buffer, name)[place][seen]
        torch.testing.assert_close(own, other, rtol=0.0, atol=1e-5)
    area, other = (values[1:-1, 1:-1].sum() for values in (window.buffer.area, full.buffer.area[place]))
    assert float(area) == pytest.approx(float(other), rel=0.05)
    assert float(window.buffer.area.sum()) == pytest.approx(float(area)), "no score asks for the border"
    torch.testing.assert_close(
        window.geometry[:, seen], full.geometry[(slice(None), *place)][:, seen], rtol=0, atol=1e-5
    )


def test_the_layer_of_a_window_is_that_of_the_whole_map(scene: Scene, whole: Scene, tmp_path: Path) -> None:
    loader = SceneLoader(tmp_path)
    painted, full, place = loader.layer(scene), loader.layer(whole), place_of(loader, scene)
    assert painted is not None
    assert full is not None
    assert painted.values.shape == (SIZE, SIZE, 5)
    seen = loader.subject(scene).buffer.mask.clone()
    seen[[0, -1]], seen[:, [0, -1]] = False, False
    assert painted.alpha[seen].std() > 0.1, "there is something to paint"
    off = (painted.values - full.values[place]).abs()[seen]
    assert float(off.mean()) < 0.01
    assert float(off.quantile(0.98)) < 0.05
    border = painted.alpha.clone()
    border[1:-1, 1:-1] = 0.0
    assert not border.any()


def test_visibility_and_curvature_of_a_window_are_interpolated_and_edges_exact(
    scene: Scene, whole: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("svbrdfgan.scene.loader.WHOLE", TEXTURE // 2)
    loader = SceneLoader(tmp_path)
    window, full, place = loader.mesh_maps(scene), loader.mesh_maps(whole), place_of(loader, scene)
    seen = loader.subject(scene).buffer.mask
    for name, most in {"visibility": 0.02, "curvature": 0.04, "convex": 1e-5, "crease": 1e-5, "border": 1e-5}.items():
        own, other = getattr(window, name)[seen], getattr(full, name)[place][seen]
        assert float((own - other).abs().mean()) < most, name
    assert not torch.equal(window.visibility[seen], full.visibility[place][seen])
    assert full.visibility[place][seen].std() > 0.05


def test_a_picture_shows_the_window_weathered_and_the_rest_clean(
    scene: Scene, whole: Scene, tmp_path: Path, cpu_renderer: Any, quick_renderer: str
) -> None:
    loader, renderer = SceneLoader(tmp_path), CheckedRenderer(cpu_renderer, quick_renderer)
    scenes = scene, whole, whole.model_copy(update={"weathering": None})
    near, full, clean = (render_scene(loader, renderer, each).image for each in scenes)
    surface, (rows, cols) = loader.subject(whole).surface, place_of(loader, scene)
    hits = camera_hits(surface, scene.camera.camera(), FILM, FILM)
    col, row = (hits.interpolate(surface.uv) * TEXTURE).transpose(2, 0, 1)
    inside = (row > rows.start + 3) & (row < rows.stop - 3) & (col > cols.start + 3) & (col < cols.stop - 3)
    outside = (row < rows.start - 3) | (row > rows.stop + 3) | (col < cols.start - 3) | (col > cols.stop + 3)
    shown = hits.hit & np.isin(hits.part, loader.subject(whole).learnable)
    assert (shown & inside).mean() > 0.3
    assert (shown & outside).mean() > 0.02
    weathered, spared = torch.from_numpy(shown & inside), torch.from_numpy(shown & outside)
    assert float((full - clean).abs()[weathered].mean()) > 0.02
    assert float((near - full).abs()[weathered].mean()) < 0.1 * float((full - clean).abs()[weathered].mean())
    torch.testing.assert_close(near[spared], clean[spared], rtol=1e-3, atol=1e-3)


def test_windows_are_cached_by_camera_and_the_oldest_are_forgotten(
    scene: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("svbrdfgan.scene.loader.KEPT", 2)
    loader = SceneLoader(tmp_path)
    first = loader.subject(scene)
    assert loader.subject(scene) is first
    cameras = [scene.camera.model_copy(update={"azimuth_degrees": angle}) for angle in (90.0, 95.0)]
    others = [loader.subject(scene.model_copy(update={"camera": camera})) for camera in cameras]
    assert len({id(first), *map(id, others)}) == 3, "each camera has a window of its own"
    again = loader.subject(scene)
    assert again is not first, "two windows are kept"
    assert np.array_equal(again.surface.uv, first.surface.uv), "it was read from its file"


def test_a_window_lies_where_most_is_seen() -> None:
    positions = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    surface = flat(positions)
    camera = Camera((0.6, 0.3, 1.0), (0.6, 0.3, 0.0), vertical_fov=2.0 * np.arctan(0.1))
    window = find_window(surface, (0,), camera, 1.0, 64, 256)
    assert window.size == 64
    assert window.col % 4 == window.row % 4 == 0
    middle = np.array([window.col, window.row]) + 32
    assert np.abs(middle / 256 - (0.6, 0.3)).max() < 0.03, "what is seen lies in its midst"
    away = Camera((0.6, 0.3, 1.0), (0.6, 0.3, 2.0))
    assert find_window(surface, (0,), away, 1.0, 64, 256) == Window(96, 96, 64), "nothing is seen"
    assert find_window(surface, (0,), camera, 1.0, 256, 256) == Window(0, 0, 256)
    corner = Camera((0.99, 0.99, 1.0), (0.99, 0.99, 0.0), vertical_fov=2.0 * np.arctan(0.05))
    assert find_window(surface, (0,), corner, 2.0, 64, 256) == Window(192, 192, 64), "it stays on the map"


def test_uvs_outside_a_window_are_outside_the_unit_square() -> None:
    surface = flat(np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]))
    moved = windowed(surface, Window(32, 64, 64), 256)
    np.testing.assert_allclose(moved.uv[0], [-1.0, -0.5])
    np.testing.assert_allclose(moved.uv[2], [3.0, 3.5])
    assert np.array_equal(moved.positions, surface.positions)


def test_only_the_border_of_a_layer_is_cleared() -> None:
    layer = Layer(bordered(torch.ones(2, 8, 8, 5)), ("roughness",))
    assert torch.equal(layer.base_color, torch.ones(2, 8, 8, 3))
    assert torch.equal(layer["roughness"], torch.ones(2, 8, 8, 1))
    assert torch.equal(layer.alpha[:, 1:-1, 1:-1], torch.ones(2, 6, 6))
    assert int(layer.alpha.sum()) == 72


def test_windows_that_cannot_be_are_told(scene: Scene, tmp_path: Path, van: Path, dataset_data: Any) -> None:
    wide = dataset_data(texture=64, camera={"close_ups": {"window": 128}})
    with pytest.raises(ConfigError, match=r"close_ups.window is 128, and texture 64"):
        validate(DatasetConfig, wide, "here")
    modelled = dataset_data(texture=64, camera={"close_ups": {"window": 32}}, weathering={"model": "rust"})
    with pytest.raises(ConfigError, match=r"a model paints whole layers: leave out close_ups.window"):
        validate(DatasetConfig, modelled, "here")
    repeating = scene.model_copy(update={"embedding": scene.embedding.model_copy(update={"name": "tiled"})})
    loader = SceneLoader(tmp_path)
    plain = loader.subject(scene.model_copy(update={"window": None}))

    class Tiled(SceneLoader):
        def subject(self, scene: Scene) -> Any:
            if scene.window is not None:
                return super().subject(scene)
            return replace(plain, surface=replace(plain.surface, repeat=(True, False)))

    with pytest.raises(AssetError, match="textures repeat in its embedding, so that it has no windows"):
        Tiled(tmp_path, keep=False).subject(repeating)


def flat(positions: Any) -> Surface:
    """Two triangles, whose UVs are x and y."""
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    return Surface(
        positions=positions,
        normals=np.tile([0.0, 0, 1], (4, 1)),
        uv=positions[:, :2].copy(),
        faces=faces,
        face_part=np.zeros(2, dtype=np.int64),
        parts=(Part("body"),),
        elevation=np.zeros(4),
        source_face=np.arange(2),
        source_barycentric=np.tile(np.eye(3), (2, 1, 1)),
    )


def test_a_window_is_kept_without_what_all_windows_share(scene: Scene, whole: Scene, tmp_path: Path) -> None:
    made = SceneLoader(tmp_path).subject(scene)
    loader = SceneLoader(tmp_path)
    loaded, surface = loader.subject(scene), loader.subject(whole).surface
    for field in fields(Surface):
        mine, its = getattr(made.surface, field.name), getattr(loaded.surface, field.name)
        if isinstance(mine, np.ndarray):
            np.testing.assert_array_equal(mine, its, err_msg=field.name)
    assert torch.equal(made.buffer.position, loaded.buffer.position)
    aside = scene.camera.model_copy(update={"azimuth_degrees": 95.0})
    assert loaded.surface.positions is loader.subject(scene.model_copy(update={"camera": aside})).surface.positions
    assert not np.array_equal(loaded.surface.uv, surface.uv)
    path = tmp_path / "cache" / "subjects" / f"{subject_key(scene)}.safetensors"
    with safe_open(path, framework="pt") as file:
        assert [name for name in file.keys() if name.startswith("surface.")] == ["surface.uv"]  # noqa: SIM118
    with pytest.raises(AssetError, match=r"cannot be read .*delete it"):
        load_subject(path, SIZE)
