"""The photographer's guide, from an empty folder to a weathered GLB, by its own commands; Blender is the camera."""

from __future__ import annotations

import re
import shlex
import shutil
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import trimesh
import yaml
from click.testing import CliRunner
from PIL import Image

from svbrdfgan.cli import main

sys.path.append(str(Path(__file__).parents[1] / "asset"))

PAGE = "docs/own-pictures.md"
PHOTOS: dict[str, Any] = {
    "image": [96, 64],
    "weathering": {"recipe": "road-dirt", "amount": 1},
    "maps": {"roughness": 0.4},
    "environments": {"procedural": {"count": 2}},
    "splits": {"train": {"meshes": {"procedural": {"count": 2, "seed": 1}}, "views": 2}},
    "photography": {"samples": 8, "masks": 1, "pool": {"procedural": {"count": 2, "seed": 9}}},
}
IMPORT = ["image=[32, 32]", "texture=32", "bootstrap=1"]
TRAIN = ["steps=4", "batch_size=2", "spp=8", "generator.width=4", "generator.blocks=1", "discriminator.width=4"]
SMALLER = {
    "dataset photograph": [],
    "dataset import": [*IMPORT, "--workers", "1"],
    "learn": [*TRAIN, *(f"manifest.{word}" for word in IMPORT), "--workers", "1"],
    "texture": ["--picture", "polo.png", "--resolution", "64"],
}
"""What is added to the commands of the page, so that they take minutes."""


@pytest.fixture
def follow(code_blocks: Callable[[str, str], list[str]]) -> Callable[..., None]:
    """Runs the one command of the page that begins so, made smaller."""
    lines = [line for block in code_blocks(PAGE, "sh") for line in block.splitlines()]

    def run(command: str, *further: str) -> None:
        (line,) = (line for line in lines if line.startswith(command))
        words = shlex.split(line)[1:]
        (kind,) = (kind for kind in SMALLER if line.startswith(f"svbrdfgan {kind}"))
        result = CliRunner().invoke(main, [*words, *SMALLER[kind], *further])
        assert result.exit_code == 0, result.output

    return run


@pytest.mark.full
def test_a_photographer_comes_from_pictures_to_a_weathered_file(
    follow: Callable[..., None],
    code_blocks: Callable[[str, str], list[str]],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    from blender import python

    monkeypatch.chdir(tmp_path)
    (config,) = (block for block in code_blocks(PAGE, "yaml") if re.match(r"spp: \d", block))
    Path("train.yaml").write_text(config)
    Path("photos.yaml").write_text(yaml.safe_dump(PHOTOS))
    follow("svbrdfgan dataset photograph", "--blender", str(python()))

    # the photographer goes on in that folder, without the truth
    shutil.rmtree("staged/truth")
    shutil.copy("train.yaml", "staged")
    monkeypatch.chdir("staged")
    Path("cars").mkdir()
    shutil.copy(next(Path("meshes").glob("*.glb")), "cars/polo.glb")
    follow("svbrdfgan dataset import manifest.yaml -o data/own --preview")
    assert Image.open("data/own/overlay/contact-sheet.png").width > 100
    follow("svbrdfgan learn manifest.yaml")
    follow("svbrdfgan texture cars/polo.glb")
    scene = trimesh.load_scene("polo.glb")
    textures = [mesh.visual.material.baseColorTexture for mesh in scene.geometry.values()]
    assert any(texture is not None and len(texture.convert("RGB").getcolors(1 << 24) or ()) > 9 for texture in textures)
    assert len(Image.open("polo.png").convert("RGB").getcolors(1 << 24) or ()) > 99
