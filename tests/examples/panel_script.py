"""What the add-on of `examples/blender` does to a scene, as JSON; run by `test_blender_panel.py` with Blender's Python.

`python panel_script.py WORDS`: a JSON object with `repository`, `judge` (the folder of `blender_script.py`), `addon`,
`program`, `car`, `clean` (a GLB to write of what weathers, before), `picture` (EXR), `size`, `samples` and `answer`, a
file.
"""

import json
import os
import shutil
import sys
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import bpy
import numpy as np

ADDON = "svbrdfgan_panel"


def scene(car: str) -> None:
    """A car; a turned ball of two materials, with a modifier; a bare box; and a twin of the ball, which alone
    is not selected."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.import_scene.gltf(filepath=car)
    vehicle = [thing for thing in bpy.data.objects if thing.type == "MESH"]
    for thing in vehicle:
        thing.scale = (4, 4, 4)
    bpy.ops.mesh.primitive_uv_sphere_add(segments=16, ring_count=8, location=(2.5, 0, 1), rotation=(0.3, 0.2, 0.1))
    ball = bpy.context.object
    ball.name, ball.scale = "Ball", (1, 0.8, 0.6)
    ball.data.uv_layers[0].name = "Mine"
    ball.data.materials.append(material("Glass", (0.05, 0.05, 0.6, 1)))
    ball.data.materials.append(material("Red", (0.6, 0.05, 0.05, 1)))
    texture(ball.data.materials["Red"])
    for polygon in ball.data.polygons:
        polygon.material_index = polygon.index % 3 > 0
    ball.vertex_groups.new(name="half").add(range(20), 1, "REPLACE")
    ball.modifiers.new("Smooth", "SUBSURF").levels = 2
    twin = ball.copy()
    twin.name, twin.location = "Twin", (0, 30, 1)
    bpy.context.scene.collection.objects.link(twin)
    bpy.ops.mesh.primitive_cube_add(size=1, location=(2.5, 2, 0.5), calc_uvs=False)
    box = bpy.context.object
    box.name = "Box"
    for thing in bpy.data.objects:
        thing.select_set(thing in [ball, box, *vehicle])
    bpy.context.view_layer.update()


def material(name: str, color: tuple[float, ...]) -> Any:
    made = bpy.data.materials.new(name)
    made.use_nodes = True
    made.node_tree.nodes["Principled BSDF"].inputs["Base Color"].default_value = color
    return made


def texture(given: Any) -> None:
    """A red picture in place of the colour: its entry in the file keeps its name when it weathers."""
    picture = bpy.data.images.new("paint", 32, 32)
    picture.pixels = [0.8, 0.2, 0.2, 1] * 32 * 32
    nodes, links = given.node_tree.nodes, given.node_tree.links
    shown = nodes.new("ShaderNodeTexImage")
    shown.image = picture
    links.new(shown.outputs["Color"], nodes["Principled BSDF"].inputs["Base Color"])


def state() -> dict[str, Any]:
    """All objects, and what is selected and there."""
    things = {thing.name: described(thing) for thing in bpy.data.objects}
    kinds = ("meshes", "materials", "images", "collections")
    return {
        "objects": things,
        "selected": sorted(thing.name for thing in bpy.context.selected_objects),
        "active": bpy.context.view_layer.objects.active.name,
        **{kind: sorted(each.name for each in getattr(bpy.data, kind)) for kind in kinds},
    }


def described(thing: Any) -> dict[str, Any]:
    facts = {"matrix": [list(row) for row in thing.matrix_world], "own": sorted(thing.keys())}
    if thing.type != "MESH":
        return facts
    mesh = thing.data
    counts = [len(mesh.vertices), len(mesh.edges), len(mesh.polygons)]
    return {
        **facts,
        "modifiers": [(each.name, each.type) for each in thing.modifiers],
        "groups": [group.name for group in thing.vertex_groups],
        "counts": counts,
        "uv_maps": [layer.name for layer in mesh.uv_layers],
        "materials": [slot.name for slot in thing.material_slots],
        "looked_up": [looked_up(slot.material) for slot in thing.material_slots],
    }


def looked_up(given: Any) -> list[str]:
    """The UV maps that a material's nodes name, without repeats."""
    return sorted({node.uv_map for node in given.node_tree.nodes if getattr(node, "uv_map", "")})


def carried(by_place: bool) -> list[Any]:
    """Of a square whose two triangles get UVs, alike where they meet or not: whether it stays, its faces, its UVs."""
    place = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
    square, made = bpy.data.meshes.new("square"), bpy.data.meshes.new("made")
    square.from_pydata(place, [], [(0, 1, 2, 3)])
    square.calc_loop_triangles()
    corners = np.array([loop for triangle in square.loop_triangles for loop in triangle.loops])
    made.from_pydata([place[corner] for corner in corners], [], [(0, 1, 2), (3, 4, 5)])
    uv = [place[corner][:2] if by_place else (number / 8, 0) for number, corner in enumerate(corners)]
    made.uv_layers.new(name="UVMap").uv.foreach_set("vector", np.array(uv, np.float32).ravel())
    found = sys.modules[ADDON].with_uvs(square, made, corners, np.zeros(2, np.int32))
    given = [list(each.vector) for each in found.uv_layers[0].uv]
    return [found == square, len(found.polygons), given]


def found(folder: Path, repository: str) -> list[Any]:
    """What starts svbrdfgan where no path is named: on PATH, nowhere, and with the package in Blender's Python."""
    panel, paths = sys.modules[ADDON], os.environ["PATH"]
    answers: list[Any] = []
    for each in (str(folder), ""):
        os.environ["PATH"] = each
        try:
            answers.append(panel.program(bpy.context))
        except RuntimeError as error:
            answers.append(str(error))
    os.environ["PATH"] = paths
    sys.path.append(repository)
    answers.append(panel.program(bpy.context)[1:])
    sys.path.remove(repository)
    return answers


def cancelled() -> dict[str, Any]:
    """What Esc leaves of a program that would take a minute and that says its number and where its file is."""
    work, said = sys.modules[ADDON].weathered(bpy.context), ""
    while not said:
        said = next(work)
        time.sleep(0.05)
    number, file = said.split()
    texts: list[Any] = []
    there = os.path.exists(file), os.path.exists(f"/proc/{number}")
    operator = SimpleNamespace(_work=work, _timer=None, _said="")
    workspace, manager = SimpleNamespace(status_text_set=texts.append), SimpleNamespace(event_timer_remove=texts.append)
    context = SimpleNamespace(workspace=workspace, window_manager=manager)
    state = bpy.types.SVBRDFGAN_OT_weather.modal(operator, context, SimpleNamespace(type="ESC"))
    left = os.path.exists(file), os.path.exists(f"/proc/{number}")
    return {"state": list(state), "there": there, "left": left, "texts": texts}


def told() -> str:
    """What the operator says if it fails, else nothing."""
    try:
        bpy.ops.svbrdfgan.weather("EXEC_DEFAULT", True)
    except RuntimeError as error:
        return str(error).strip()
    return ""


def registered() -> bool:
    return hasattr(bpy.types, "VIEW3D_PT_svbrdfgan") and "weather" in dir(bpy.ops.svbrdfgan)


def seen(words: dict[str, Any]) -> dict[str, Any]:
    """A picture of what is selected, by the judge's camera; returns that camera, in Blender's axes."""
    sys.path.append(words["judge"])
    import blender_script as judge

    for thing in list(bpy.data.objects):
        if not thing.select_get():
            bpy.data.objects.remove(thing)
    bpy.data.objects["Ball"].modifiers.clear()  # our renderer shows the file, which is without
    bpy.context.view_layer.update()
    centre, radius = judge.framed()
    judge.look_at(centre, radius)
    judge.rendered(words["picture"], words["size"], words["samples"], 0)
    camera = bpy.context.scene.camera
    return {"origin": list(camera.location), "target": list(centre), "angle": camera.data.angle}


def main(words: dict[str, Any]) -> None:
    answer: dict[str, Any] = {}
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.preferences.addon_install(filepath=words["addon"])
    answer["first"] = registered()
    bpy.ops.preferences.addon_enable(module=ADDON)
    answer["enabled"] = registered()
    scene(words["car"])
    bpy.ops.preferences.addon_enable(module=ADDON)  # reading the factory's settings disabled it
    chosen = bpy.context.preferences.addons[ADDON].preferences
    chosen.painter, chosen.amount, chosen.seed, chosen.size = "rust", 0.9, 3, 256
    answer["before"] = state()
    folder = Path(words["car"]).with_name("programs")
    folder.mkdir()
    slow = folder / "svbrdfgan"
    slow.write_text(f'#!/bin/sh\necho "$$ ${{10}}"\nexec {shutil.which("sleep")} 60\n')
    slow.chmod(0o755)
    answer["found"] = found(folder, words["repository"])
    chosen.program = str(slow)
    answer["cancelled"] = cancelled()
    chosen.program = str(Path(words["car"]).with_name("no-such-program"))
    answer["no_program"], answer["after_no_program"] = told(), state()
    chosen.program, chosen.painter, chosen.model = words["program"], "MODEL", "nonsense"
    answer["no_model"], answer["after_no_model"] = told(), state()
    sys.modules[ADDON].exported(bpy.context, words["clean"])
    answer["after_export"] = state()
    chosen.painter = "rust"
    bpy.ops.ed.undo_push(message="before")
    answer["fault"], answer["after"] = told(), state()
    bpy.ops.ed.undo()
    answer["undone"] = state()
    bpy.ops.ed.redo()
    answer["carried"] = [carried(True), carried(False)]
    answer["camera"] = seen(words)
    bpy.ops.preferences.addon_disable(module=ADDON)
    answer["disabled"] = registered()
    Path(words["answer"]).write_text(json.dumps(answer), encoding="utf-8")


main(json.loads(sys.argv[-1]))
