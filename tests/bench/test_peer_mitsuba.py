"""The peer that is Mitsuba used directly does the same work as ours."""

import importlib.util
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from svbrdfgan.bench.bench_scene import BenchScene
from svbrdfgan.bench.cases import Case
from svbrdfgan.bench.programs import Program
from svbrdfgan.bench.standard_scenes import glossy_scene, standard_scene
from svbrdfgan.plugins.registry import load_renderer

pytestmark = pytest.mark.skipif(importlib.util.find_spec("mitsuba") is None, reason="Mitsuba is not installed")
PEER = Path(__file__).parents[2] / "benchmarks" / "peer_mitsuba.py"
RENDER = """
import runpy, sys, numpy as np
from svbrdfgan_mitsuba import MitsubaRenderer
MitsubaRenderer()  # which finds LLVM
import mitsuba as mi
mi.set_variant("llvm_ad_rgb")
peer = runpy.run_path(sys.argv[1])
with np.load(sys.argv[2]) as arrays:
    np.save(sys.argv[3], np.array(mi.render(peer["_scene"](mi, arrays), spp=1024))[..., :3])
"""


@pytest.fixture(scope="module")
def scene() -> BenchScene:
    """Two parts; a texture whose left, right, upper and lower halves differ; smooth light from one side."""
    whole = standard_scene(900, 12, 8)
    part = (whole.faces[:, 0] >= 540).astype(np.int32)
    texture = whole.texture.copy()
    texture[:4] *= 0.2
    texture[:, :4] *= 0.4
    turn = np.cos((np.arange(16) + 0.5) / 16 * 2 * np.pi - 1.0)
    light = np.broadcast_to(1.0 + 0.9 * turn[:, None], (8, 16, 3)).astype(np.float32)
    colors = np.float32([[0, 0, 0], [0.1, 0.5, 0.9]])
    return replace(whole, face_part=part, base_color=colors, texture=texture, radiance=np.ascontiguousarray(light))


@pytest.mark.full
def test_its_picture_is_ours(scene: BenchScene, tmp_path: Path) -> None:
    scene.save(tmp_path / "scene.npz")
    words = [sys.executable, "-c", RENDER, PEER, tmp_path / "scene.npz", tmp_path / "picture.npy"]
    done = subprocess.run(words, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    theirs = torch.from_numpy(np.load(tmp_path / "picture.npy"))
    renderer = load_renderer("numpy")
    materials = scene.materials(scene.textures(renderer.device))
    ours = renderer.render(renderer.prepare(scene.surface()), materials, scene.view(), spp=512, seed=0).image
    apart = float((ours - theirs).abs().mean() / ours.mean())
    assert apart < 0.1  # 0.24 with the light mirrored, 0.9 with the texture upside down
    assert torch.allclose(ours.mean((0, 1)), theirs.mean((0, 1)), rtol=0.02)


@pytest.mark.parametrize("whole", [False, True])
def test_it_prints_its_figures(scene: BenchScene, tmp_path: Path, whole: bool) -> None:
    (glossy_scene(scene) if whole else scene).save(tmp_path / "scene.npz")
    program = Program.peer(f"'{sys.executable}' '{PEER}' {{scene}} --spp {{spp}} --repeats 1 --variant llvm_ad_rgb")
    figures = program.run(Case("standard", 900, 12, 4), tmp_path / "scene.npz", 1)
    assert figures.name.startswith("mitsuba 3.")
    assert list(figures.seconds) == ["prepare", "forward", "forward_backward"]
