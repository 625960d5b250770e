"""The files of `svbrdfgan bake`, of two half spheres over the ground of radius 1 and 0.5."""

import json
from pathlib import Path

import numpy as np
import pytest
import torch
import trimesh
from svbrdfgan_hemispherical import HemisphericalEmbedding

from svbrdfgan.geometry.bake import bake
from svbrdfgan.geometry.layers import embed_and_rasterize
from svbrdfgan.io.exr import load_exr
from svbrdfgan.io.mesh import load_mesh
from svbrdfgan.report.baked_files import write_bake
from svbrdfgan.types import Mesh, Part


def test_files_hold_what_was_baked(tmp_path: Path) -> None:
    ball = trimesh.creation.icosphere(subdivisions=3)
    faces = np.asarray(ball.faces[ball.vertices[ball.faces][:, :, 1].min(axis=1) > -1e-9])
    positions = np.concatenate([ball.vertices, 0.5 * ball.vertices])
    both = np.concatenate([faces, faces + len(ball.vertices)])
    mesh = Mesh(positions, both, np.repeat([0, 1], len(faces)), (Part("outer"), Part("inner")))
    fragments = embed_and_rasterize(HemisphericalEmbedding(resolution=64), mesh, 64)
    buffer = bake(fragments)
    metrics = write_bake(tmp_path / "new" / "folder", mesh, fragments, buffer)
    folder = tmp_path / "new" / "folder"
    assert json.loads((folder / "metrics.json").read_text()) == metrics
    assert metrics["layers_max"] >= 2
    assert metrics["exposed_area_share"] == pytest.approx(0.8, abs=0.01)  # 1 / (1 + 0.5^2)
    channels = load_exr(folder / "geometry_buffer.exr", uv_map=True)
    assert torch.equal(channels["position.Y"], buffer.position[..., 1])
    assert torch.equal(channels["part"].long(), buffer.part)
    assert {"normal.X", "normal.Y", "normal.Z", "mask", "area"} <= set(channels)
    assert len(load_mesh(folder / "surface.glb").faces) > 0
    assert (folder / "position.png").stat().st_size > 0
    assert (folder / "normal.png").stat().st_size > 0
