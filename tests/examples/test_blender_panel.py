"""The add-on of `examples/blender` weathers what is selected, in place, and nothing else."""

from __future__ import annotations

import copy
import json
import math
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
import torch

from svbrdfgan.cli import main
from svbrdfgan.inference.file_scene import file_scene
from svbrdfgan.inference.tone_mapping import neutral_tone
from svbrdfgan.io.gltf.surface_files import save_mesh_glb
from svbrdfgan.io.image import load_image, save_image
from svbrdfgan.io.mesh import load_mesh
from svbrdfgan.procedural.kinds import sample_vehicle
from svbrdfgan.procedural.vehicle import build_vehicle
from svbrdfgan.rendering.checked_renderer import CheckedRenderer
from svbrdfgan.rendering.compositing import over
from svbrdfgan.types import Camera, Environment, View

REPOSITORY = Path(__file__).parents[2]
ADDON = REPOSITORY / "examples" / "blender" / "svbrdfgan_panel.py"
SCRIPT = Path(__file__).with_name("panel_script.py")
SIZE = (256, 192)
SAMPLES = 64
GREY = 0.5
"""Of the light, which is alike from everywhere."""
NEAR = 0.01
"""Mean error of display values where something is seen, between Cycles's shading and ours."""


def test_the_add_on_is_one_short_file() -> None:
    lines = ADDON.read_text(encoding="utf-8").splitlines()
    assert 100 < len(lines) < 250
    assert "import svbrdfgan" not in lines, "Blender's own Python may not have the package"


@dataclass(frozen=True)
class Worked:
    """What the script answered, and the files that it wrote."""

    answer: dict[str, Any]
    clean: Path
    picture: Path

    def objects(self, moment: str) -> dict[str, Any]:
        found: dict[str, Any] = self.answer[moment]["objects"]
        return found


@pytest.fixture(scope="module")
def worked(tmp_path_factory: pytest.TempPathFactory) -> Worked:
    from blender import python, ran

    folder = tmp_path_factory.mktemp("panel")
    save_mesh_glb(folder / "car.glb", build_vehicle(sample_vehicle("sedan", 5)))
    words = {
        "repository": str(REPOSITORY),
        "judge": str(REPOSITORY / "tests" / "asset"),
        "addon": str(ADDON),
        "program": str(Path(sys.executable).with_name("svbrdfgan")),
        **{name: str(folder / f"{name}.glb") for name in ("car", "clean")},
        "picture": str(folder / "theirs.exr"),
        "answer": str(folder / "answer.json"),
        "size": SIZE,
        "samples": SAMPLES,
    }
    ran([python(), SCRIPT, json.dumps(words)], BLENDER_USER_RESOURCES=str(folder / "blender"))
    answer = json.loads((folder / "answer.json").read_text(encoding="utf-8"))
    return Worked(answer, folder / "clean.glb", folder / "theirs.exr")


@pytest.mark.full
def test_the_add_on_comes_and_goes(worked: Worked) -> None:
    assert [worked.answer[moment] for moment in ("first", "enabled", "disabled")] == [False, True, False]


@pytest.mark.full
def test_the_program_is_found(worked: Worked) -> None:
    on_path, nowhere, own = worked.answer["found"]
    assert on_path == [str(worked.clean.with_name("programs") / "svbrdfgan")]
    assert nowhere.startswith("No program svbrdfgan was found: ")
    assert own == ["-m", "svbrdfgan"]


@pytest.mark.full
def test_escape_ends_the_program(worked: Worked) -> None:
    cancelled = worked.answer["cancelled"]
    assert cancelled["state"] == ["CANCELLED"]
    assert (cancelled["there"], cancelled["left"]) == ([True, True], [False, False])
    assert cancelled["texts"] == [None, None], "no status, and no timer"


@pytest.mark.full
def test_a_program_that_is_not_there_is_told_in_one_sentence(worked: Worked) -> None:
    (line,) = worked.answer["no_program"].splitlines()
    assert "no-such-program cannot be run: No such file or directory." in line
    assert worked.answer["after_no_program"] == worked.answer["before"]


@pytest.mark.full
def test_the_program_s_own_sentence_is_shown(worked: Worked) -> None:
    (line,) = worked.answer["no_model"].splitlines()
    assert "nonsense is not a run: it has no config.json; and no model of that name is shipped" in line
    assert worked.answer["after_no_model"] == worked.answer["before"]


@pytest.mark.full
def test_an_export_leaves_no_trace(worked: Worked) -> None:
    assert worked.answer["after_export"] == worked.answer["before"]


@pytest.mark.full
def test_what_is_selected_has_weathered_materials(worked: Worked) -> None:
    assert worked.answer["fault"] == ""
    before, after = worked.objects("before"), worked.objects("after")
    assert before["Ball"]["materials"] == ["Glass", "Red"]
    assert after["Ball"]["materials"] == ["Glass", "Red weathered"]
    assert after["Ball"]["looked_up"][1] == after["Ball"]["uv_maps"] == ["Mine"]
    assert (before["body"]["uv_maps"], after["body"]["uv_maps"]) == ([], ["Weathering"])
    assert after["body"]["materials"] == ["body weathered"]
    assert (before["Box"]["materials"], after["Box"]["materials"]) == ([], ["Box weathered"])


@pytest.mark.full
def test_materials_that_are_kept_stay_the_user_s(worked: Worked) -> None:
    before, after = worked.answer["before"], worked.answer["after"]
    assert after["objects"]["glass"] == before["objects"]["glass"]
    used = {name for thing in after["objects"].values() for name in thing.get("materials", [])}
    assert set(before["materials"]) <= set(after["materials"])
    assert set(after["materials"]) - set(before["materials"]) <= used, "nothing is left over"


@pytest.mark.full
def test_polygons_stay_unless_new_uvs_cut_them(worked: Worked) -> None:
    whole, cut = worked.answer["carried"]
    assert whole == [True, 1, [[0, 0], [1, 0], [1, 1], [0, 1]]]
    assert cut == [False, 2, [[number / 8, 0] for number in range(6)]]


@pytest.mark.full
def test_all_else_of_the_scene_stays(worked: Worked) -> None:
    before, after = (copy.deepcopy(worked.answer[moment]) for moment in ("before", "after"))
    assert after["objects"]["Twin"] == before["objects"]["Twin"], "the twin shares the ball's mesh"
    assert before["objects"]["Ball"]["modifiers"] == [["Smooth", "SUBSURF"]]
    for state in (before, after):
        del state["materials"], state["images"], state["meshes"]
        for thing in state["objects"].values():
            for changed in ("materials", "uv_maps", "looked_up"):
                thing.pop(changed, None)
    assert after == before


@pytest.mark.full
def test_one_step_back_undoes_it(worked: Worked) -> None:
    assert worked.answer["after"] != worked.answer["before"]
    assert worked.answer["undone"]["objects"] == worked.answer["before"]["objects"]


@pytest.mark.full
def test_cycles_shows_what_our_renderer_shows_of_the_program_s_file(
    worked: Worked, cpu_renderer: Any, quick_renderer: str, tmp_path: Path
) -> None:
    """In a light that is alike from everywhere, without bounces; a clean car is farther off."""
    camera = camera_of(worked.answer["camera"])
    theirs = neutral_tone(load_image(worked.picture)[..., :3])
    words = ["weather", str(worked.clean), "--recipe", "rust", "--amount", "0.9", "--seed", "3", "--size", "256"]
    main([*words, "-o", str(tmp_path / "dirty.glb")], standalone_mode=False)
    renderer = CheckedRenderer(cpu_renderer, quick_renderer)
    ours, inside = rendered(tmp_path / "dirty.glb", camera, renderer)
    clean, _ = rendered(worked.clean, camera, renderer)
    save_image(tmp_path / "theirs_and_ours.png", torch.cat([theirs, ours], dim=1))
    error, other = (float((each - theirs).abs()[inside].mean()) for each in (ours, clean))
    assert inside.float().mean() > 0.1
    assert error < NEAR
    assert other > 2 * error


def camera_of(given: dict[str, Any]) -> Camera:
    """The judge's camera, in the axes of files, y upwards."""
    (x, y, z), (right, back, up) = given["origin"], given["target"]
    across = math.tan(given["angle"] / 2)
    return Camera((x, z, -y), (right, up, -back), vertical_fov=2 * math.atan(across * SIZE[1] / SIZE[0]))


def rendered(path: Path, camera: Camera, renderer: CheckedRenderer) -> tuple[torch.Tensor, torch.Tensor]:
    """The file's picture, and where something is seen in it."""
    surface, materials = file_scene(load_mesh(path))
    view = View(camera, Environment(torch.full((16, 32, 3), GREY)), *SIZE)
    seen = renderer.render(renderer.prepare(surface), materials, view, spp=SAMPLES, seed=0)
    return neutral_tone(over(seen.image, seen.coverage, torch.full_like(seen.image, GREY))), seen.coverage > 0
