"""Photographs by Blender's Cycles. Blender's own Python runs this file, so it imports nothing of the package.

`blender --background --python blender_script.py -- JOBS` or `python blender_script.py JOBS`: a JSON file, a list of
what `svbrdfgan.data.staged_photos.cycles.Shot` holds. A line of standard output tells of each picture that is done.
"""

import json
import math
import sys
import tempfile
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from mathutils import Matrix, Vector

Shot = dict[str, Any]
GREY = 0.18
MOST = 6e4
"""Half precision holds no more than 65,504."""
SAMPLED = 256  # columns of the map by which Cycles chooses directions: its own choice takes seconds to make
SENSOR = 24.0
"""Height in millimetres."""
Y_UP = Matrix(((1, 0, 0), (0, 0, -1), (0, 1, 0)))
"""From the package's axes, y upwards, to Blender's, z upwards."""


def take(shot: Shot) -> None:
    """Takes one picture, and another from the same tripod with the same exposure if it is wanted."""
    seen = radiance(shot, shot["mesh"])
    exposure = meter(shot, seen)
    develop(shot, seen, exposure, shot["photo"], 0)
    second = shot["second"]
    if second is None:
        return
    other = seen if second["mesh"] is None else radiance(shot, second["mesh"])
    if second["flash"] is not None:
        lit = radiance(shot, second["mesh"] or shot["mesh"], flash=True)
        other[..., :3] += lit[..., :3] * second["flash"] / exposure
    develop(shot, other, exposure, second["photo"], 1)


def radiance(shot: Shot, mesh: str, flash: bool = False) -> np.ndarray:
    """Renders the mesh; in the light of the flash alone, a white matt surface at the target's distance is 1."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.import_scene.gltf(filepath=mesh)
    scene = bpy.context.scene
    if shot["ground"] is not None:
        stand(shot["ground"])
    aim(scene, shot)
    if flash:
        shine(scene, shot)
    else:
        light(scene, shot)
    render = scene.render
    render.engine = "CYCLES"
    render.resolution_x, render.resolution_y, render.resolution_percentage = shot["width"], shot["height"], 100
    render.film_transparent = not shot["background"]
    if shot["threads"] is not None:
        render.threads_mode, render.threads = "FIXED", shot["threads"]
    scene.cycles.samples, scene.cycles.seed = shot["samples"], shot["seed"]
    scene.cycles.use_denoising = scene.cycles.use_adaptive_sampling = False
    scene.cycles.pixel_filter_type = "BOX"
    for kind in ("max", "diffuse", "glossy", "transmission"):
        setattr(scene.cycles, f"{kind}_bounces", shot["bounces"])
    with tempfile.TemporaryDirectory() as folder:
        linear = Path(folder) / "linear.exr"
        render.image_settings.file_format, render.image_settings.color_depth = "OPEN_EXR", "32"
        render.image_settings.color_mode = "RGBA"
        render.filepath = str(linear)
        bpy.ops.render.render(write_still=True)
        image = bpy.data.images.load(str(linear))
        pixels = np.empty(len(image.pixels), np.float32)
        image.pixels.foreach_get(pixels)
    return pixels.reshape(shot["height"], shot["width"], 4)


def light(scene: Any, shot: Shot) -> None:
    """The environment map, turned; its middle lies along -Z, in Blender's axes along +Y."""
    world = bpy.data.worlds.new("light")
    scene.world = world
    world.use_nodes = True
    nodes, link = world.node_tree.nodes, world.node_tree.links.new
    coordinates, mapping = nodes.new("ShaderNodeTexCoord"), nodes.new("ShaderNodeMapping")
    picture, background = nodes.new("ShaderNodeTexEnvironment"), nodes["Background"]
    picture.image = bpy.data.images.load(shot["environment"], check_existing=True)
    mapping.inputs["Rotation"].default_value = (0.0, 0.0, -math.pi / 2 - shot["rotation"])
    background.inputs["Strength"].default_value = shot["scale"]
    world.cycles.sampling_method, world.cycles.sample_map_resolution = "MANUAL", SAMPLED
    link(coordinates.outputs["Generated"], mapping.inputs["Vector"])
    link(mapping.outputs["Vector"], picture.inputs["Vector"])
    link(picture.outputs["Color"], background.inputs["Color"])


def stand(color: list[float]) -> None:
    """A rough floor of this colour beneath everything."""
    things = [thing for thing in bpy.context.scene.objects if thing.type == "MESH"]
    bpy.context.view_layer.update()
    corners = np.array([thing.matrix_world @ Vector(corner) for thing in things for corner in thing.bound_box])
    size = float(np.linalg.norm(np.ptp(corners, axis=0)))
    bpy.ops.mesh.primitive_plane_add(size=100 * size, location=(0, 0, corners[:, 2].min()))
    floor = bpy.data.materials.new("floor")
    floor.use_nodes = True
    surface = floor.node_tree.nodes["Principled BSDF"].inputs
    surface["Base Color"].default_value, surface["Roughness"].default_value = (*color, 1), 0.9
    bpy.context.object.data.materials.append(floor)


def aim(scene: Any, shot: Shot) -> None:
    """A level camera."""
    origin, target = (Y_UP @ Vector(shot[name]) for name in ("origin", "target"))
    lens = bpy.data.cameras.new("camera")
    lens.sensor_fit, lens.sensor_height = "VERTICAL", SENSOR
    lens.lens = SENSOR / 2 / math.tan(shot["vertical_fov"] / 2)
    distance = (target - origin).length
    lens.clip_start, lens.clip_end = distance / 1000, distance * 1000
    lens.dof.use_dof = shot["f_number"] is not None
    if lens.dof.use_dof:
        lens.dof.focus_distance, lens.dof.aperture_fstop = distance, shot["f_number"]
    camera = bpy.data.objects.new("camera", lens)
    camera.location = origin
    camera.rotation_euler = (target - origin).to_track_quat("-Z", "Y").to_euler()
    scene.collection.objects.link(camera)
    scene.camera = camera


def shine(scene: Any, shot: Shot) -> None:
    """A flash beside the lens."""
    scene.world = bpy.data.worlds.new("night")
    scene.world.use_nodes = True
    scene.world.node_tree.nodes["Background"].inputs["Strength"].default_value = 0.0
    origin, target = (Y_UP @ Vector(shot[name]) for name in ("origin", "target"))
    flash = bpy.data.lights.new("flash", "POINT")
    flash.energy, flash.shadow_soft_size = 4 * math.pi**2 * (target - origin).length_squared, 0.0
    thing = bpy.data.objects.new("flash", flash)
    thing.location = origin
    scene.collection.objects.link(thing)


def meter(shot: Shot, pixels: np.ndarray) -> float:
    """The exposure, a factor on radiance."""
    if shot["exposure_stops"] is None:
        return 1.0
    linear = pixels[..., :3] * np.array(shot["gain"], np.float32)
    seen = linear[pixels[..., 3] > 0.5] if not shot["background"] else linear.reshape(-1, 3)
    luminance = np.maximum(seen @ np.array([0.2126, 0.7152, 0.0722], np.float32), 1e-6)
    return float(GREY / np.exp(np.log(luminance).mean()) * 2.0 ** shot["exposure_stops"])


def develop(shot: Shot, pixels: np.ndarray, exposure: float, photo: str, number: int) -> None:
    """Exposes, balances the white, adds the sensor's noise, applies the tone curve and compresses."""
    rng, scene = np.random.default_rng([shot["seed"], number]), bpy.context.scene
    shown = np.maximum(pixels[..., :3] * np.array(shot["gain"], np.float32) * exposure, 0.0)
    noise = shot["noise"] * GREY * np.sqrt(0.5 + 0.5 * shown / GREY)  # half of it read noise, half of it photons
    taken = np.ones_like(pixels)
    taken[..., :3] = np.clip(shown + noise * rng.normal(size=shown.shape), 0.0, MOST)
    image = bpy.data.images.new("photograph", shot["width"], shot["height"], float_buffer=True)
    image.pixels.foreach_set(taken.ravel())
    settings = scene.render.image_settings
    if shot["view"] is None:
        settings.file_format, settings.color_depth = "OPEN_EXR", "16"
        image.file_format = "OPEN_EXR"
        image.save_render(photo, scene=scene)
        return
    settings.file_format, settings.color_mode, settings.quality = "JPEG", "RGB", shot["jpeg_quality"]
    scene.view_settings.view_transform = shot["view"]
    image.save_render(photo, scene=scene, quality=shot["jpeg_quality"])


for number, each in enumerate(json.loads(Path(sys.argv[-1]).read_text(encoding="utf-8"))):
    take(each)
    print(f"photograph {number} done", flush=True)
