"""What Blender sees in files, as JSON, and a small picture of each; run by `blender.py` with Blender's own Python.

`python blender_script.py WORDS`: a JSON object with `files`, `pictures` (EXR), `size`, `samples`, `bounces`, and
`answer`, a file. The camera is framed around the first file, and the same for all.
"""

import json
import sys
from pathlib import Path
from typing import Any

import bpy
from mathutils import Vector

TOWARDS_CAMERA = Vector((1.0, -1.2, 0.7)).normalized()
FIELD = 0.7
GREY = (0.5, 0.5, 0.5, 1)


def opened(path: str) -> dict[str, Any]:
    """What is in the file, after it has been opened in place of all else."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.import_scene.gltf(filepath=path)
    bpy.context.view_layer.update()
    objects = {thing.name: described(thing) for thing in bpy.context.scene.objects}
    actions = {action.name: list(action.frame_range) for action in bpy.data.actions}
    return {
        "objects": objects,
        "materials": sorted(material.name for material in bpy.data.materials),
        "actions": actions,
    }


def described(thing: Any) -> dict[str, Any]:
    parent = thing.parent.name if thing.parent else None
    facts = {"type": thing.type, "parent": parent, "matrix": [list(row) for row in thing.matrix_world]}
    if thing.type != "MESH":
        return facts
    mesh = thing.data
    keys = [key.name for key in mesh.shape_keys.key_blocks] if mesh.shape_keys else []
    counts = {"vertices": len(mesh.vertices), "faces": len(mesh.polygons), "uv_sets": len(mesh.uv_layers)}
    return {**facts, **counts, "shape_keys": keys, "materials": [slot.name for slot in thing.material_slots]}


def framed() -> tuple[Vector, float]:
    """Centre and radius of a ball around all meshes."""
    meshes = [thing for thing in bpy.context.scene.objects if thing.type == "MESH"]
    corners = [thing.matrix_world @ Vector(corner) for thing in meshes for corner in thing.bound_box]
    lowest = Vector([min((corner[axis] for corner in corners), default=-1) for axis in range(3)])
    highest = Vector([max((corner[axis] for corner in corners), default=1) for axis in range(3)])
    return (lowest + highest) / 2, max((highest - lowest).length / 2, 1e-6)


def look_at(centre: Vector, radius: float) -> None:
    """Sets a camera and a grey world that lights everything alike."""
    camera = bpy.data.cameras.new("judge")
    camera.angle = FIELD
    camera.clip_start, camera.clip_end = radius / 1000, radius * 100
    thing = bpy.data.objects.new("judge", camera)
    bpy.context.scene.collection.objects.link(thing)
    thing.location = centre + TOWARDS_CAMERA * (radius * 2.2)
    thing.rotation_euler = (-TOWARDS_CAMERA).to_track_quat("-Z", "Y").to_euler()
    bpy.context.scene.camera = thing
    world = bpy.data.worlds.new("judge")
    world.use_nodes = True
    world.node_tree.nodes["Background"].inputs["Color"].default_value = GREY
    bpy.context.scene.world = world


def rendered(picture: str, size: tuple[int, int], samples: int, bounces: int) -> None:
    """Writes a picture by Cycles on the processor, linear and not denoised; the same for the same scene."""
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.cycles.device, scene.cycles.samples, scene.cycles.seed = "CPU", samples, 0
    scene.cycles.max_bounces = bounces
    scene.cycles.use_denoising = scene.cycles.use_adaptive_sampling = False
    scene.render.resolution_x, scene.render.resolution_y = size
    scene.render.resolution_percentage = 100
    scene.render.image_settings.file_format = "OPEN_EXR"
    scene.render.image_settings.color_depth = "32"
    scene.render.filepath = picture
    bpy.ops.render.render(write_still=True)


def main(words: dict[str, Any]) -> None:
    answers, ball = [], None
    for file, picture in zip(words["files"], words["pictures"], strict=True):
        answers.append(opened(file))
        ball = ball or framed()
        look_at(*ball)
        rendered(picture, words["size"], words["samples"], words["bounces"])
    Path(words["answer"]).write_text(json.dumps(answers), encoding="utf-8")


if __name__ == "__main__":
    main(json.loads(sys.argv[1]))
