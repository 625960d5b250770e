"""Renders a case of `peer_cycles.py` by Cycles: `python peer_cycles_render.py CASE.npz OUT.npy SPP`, where `bpy` is.

The scene is built from plain arrays, so that nothing of svbrdfgan is imported where Blender is.
"""

from __future__ import annotations

import sys

import bpy
import numpy as np


def main(case_path: str, out: str, spp: int) -> None:
    case = dict(np.load(case_path))
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    _settings(scene, case, spp)
    _camera(scene, case)
    _world(scene, case["radiance"])
    if "glb" in case:
        _import(str(case["glb"]), str(case["model"]))
    else:
        _mesh(scene, case)
    bpy.ops.render.render(write_still=True)
    image = bpy.data.images.load(scene.render.filepath)
    pixels = np.empty(image.size[0] * image.size[1] * 4, dtype=np.float32)
    image.pixels.foreach_get(pixels)
    np.save(out, pixels.reshape(image.size[1], image.size[0], 4)[::-1])


def _settings(scene: bpy.types.Scene, case: dict[str, np.ndarray], spp: int) -> None:
    scene.render.engine = "CYCLES"
    cycles = scene.cycles
    cycles.samples, cycles.use_adaptive_sampling, cycles.use_denoising = spp, False, False
    cycles.pixel_filter_type = "BOX"
    cycles.sample_clamp_direct = cycles.sample_clamp_indirect = cycles.blur_glossy = 0.0
    cycles.use_light_tree, cycles.caustics_reflective, cycles.caustics_refractive = False, True, True
    bounces = int(case["bounces"]) - 1  # Cycles counts those after direct light
    cycles.max_bounces = cycles.diffuse_bounces = cycles.glossy_bounces = bounces
    scene.render.film_transparent = True
    scene.render.resolution_x, scene.render.resolution_y = (int(n) for n in case["film"])
    scene.render.resolution_percentage = 100
    scene.render.image_settings.file_format = "OPEN_EXR"
    scene.render.image_settings.color_mode, scene.render.image_settings.color_depth = "RGBA", "32"
    scene.view_settings.view_transform = "Raw"
    scene.render.filepath = str(case["filepath"])


def _upright(vectors: np.ndarray) -> np.ndarray:
    """The vectors turned from Y up to Blender's Z up."""
    return np.stack([vectors[..., 0], -vectors[..., 2], vectors[..., 1]], axis=-1)


def _camera(scene: bpy.types.Scene, case: dict[str, np.ndarray]) -> None:
    camera = bpy.data.cameras.new("camera")
    camera.sensor_fit, camera.angle_y = "VERTICAL", float(case["fov"])
    camera.clip_start, camera.clip_end = 1e-3, 1e4
    placed = bpy.data.objects.new("camera", camera)
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = _upright(case["axes"]).T, _upright(case["origin"])
    placed.matrix_world = matrix.T.tolist()  # Blender takes columns
    scene.collection.objects.link(placed)
    scene.camera = placed


def _image(name: str, values: np.ndarray) -> bpy.types.Image:
    """A float image; row 0 of the values is at the bottom, as in Blender."""
    rows, cols = values.shape[:2]
    image = bpy.data.images.new(name, cols, rows, alpha=False, float_buffer=True)
    image.colorspace_settings.name = "Non-Color"
    pixels = np.ones((rows, cols, 4), dtype=np.float32)
    pixels[..., :3] = values
    image.pixels.foreach_set(pixels.ravel())
    image.update()
    return image


def _world(scene: bpy.types.Scene, radiance: np.ndarray) -> None:
    world = bpy.data.worlds.new("world")
    scene.world = world
    nodes, links = world.node_tree.nodes, world.node_tree.links
    texture = nodes.new("ShaderNodeTexEnvironment")
    # Blender's columns start a quarter turn away from those of docs/conventions.md
    texture.image = _image("light", np.roll(radiance, -radiance.shape[1] // 4, axis=1)[::-1])
    links.new(texture.outputs["Color"], nodes["Background"].inputs["Color"])
    world.cycles.sampling_method, world.cycles.sample_map_resolution = "MANUAL", 2048


def _import(path: str, model: str) -> None:
    """The file as Blender's importer has it: a Principled BSDF for each material, or only one lobe of it."""
    bpy.ops.import_scene.gltf(filepath=path)
    if model == "imported":
        return
    for tree in (material.node_tree for material in bpy.data.materials):
        for node in (node for node in tree.nodes if node.type == "BSDF_PRINCIPLED"):
            node.distribution = "GGX"
            for link in node.inputs["Metallic"].links:
                tree.links.remove(link)
            node.inputs["Metallic"].default_value = 1.0 if model == "imported metal" else 0.0
            node.inputs["Specular IOR Level"].default_value = 0.5 if model == "imported metal" else 0.0


def _mesh(scene: bpy.types.Scene, case: dict[str, np.ndarray]) -> None:
    faces = case["faces"]
    mesh = bpy.data.meshes.new("surface")
    mesh.from_pydata(_upright(case["positions"]).tolist(), [], faces.tolist())
    layer = mesh.uv_layers.new(name="UVMap")
    layer.data.foreach_set("uv", case["uv"][faces].astype(np.float32).ravel())
    mesh.polygons.foreach_set("use_smooth", np.ones(len(faces), dtype=bool))
    mesh.polygons.foreach_set("material_index", case["face_part"].astype(np.int32))
    mesh.normals_split_custom_set(_upright(case["normals"][faces]).reshape(-1, 3).tolist())
    for part in range(int(case["parts"])):
        mesh.materials.append(_material(part, case))
    mesh.update()
    scene.collection.objects.link(bpy.data.objects.new("surface", mesh))


def _material(part: int, case: dict[str, np.ndarray]) -> bpy.types.Material:
    """Diffuse, or the metal of glTF where metallic is 1, or Principled as Blender's glTF importer connects it."""
    material = bpy.data.materials.new(f"part {part}")
    nodes, links = material.node_tree.nodes, material.node_tree.links
    nodes.clear()
    maps = {
        name: case[f"{part}.{name}"]
        for name in ("base_color", "roughness", "metallic", "normal")
        if f"{part}.{name}" in case
    }

    def connect(name: str, target: bpy.types.NodeSocket) -> None:
        values = maps[name]
        if values.ndim == 1:
            target.default_value = float(values[0]) if len(values) == 1 else (*values.tolist(), 1.0)
            return
        texture = nodes.new("ShaderNodeTexImage")
        texture.image, texture.extension = _image(f"{name} {part}", values), "EXTEND"
        links.new(texture.outputs["Color"], target)

    model = str(case["model"])
    if model == "principled":
        bsdf = nodes.new("ShaderNodeBsdfPrincipled")
        connect("metallic", bsdf.inputs["Metallic"])
    elif "metallic" in maps:
        bsdf = nodes.new("ShaderNodeBsdfMetallic")  # F82 with a white edge is Schlick's Fresnel
        bsdf.distribution, bsdf.fresnel_type = "GGX", "F82"
        bsdf.inputs["Edge Tint"].default_value = (1.0, 1.0, 1.0, 1.0)
    else:
        bsdf = nodes.new("ShaderNodeBsdfDiffuse")
        bsdf.inputs["Roughness"].default_value = 0.0
    if "Base Color" in bsdf.inputs:
        connect("base_color", bsdf.inputs["Base Color"])
    else:
        connect("base_color", bsdf.inputs["Color"])
    if "roughness" in maps:
        connect("roughness", bsdf.inputs["Roughness"])
    if "normal" in maps:
        node = nodes.new("ShaderNodeNormalMap")
        node.space, node.uv_map = "TANGENT", "UVMap"
        maps["normal"] = 0.5 + 0.5 * maps["normal"]
        connect("normal", node.inputs["Color"])
        links.new(node.outputs["Normal"], bsdf.inputs["Normal"])
    links.new(bsdf.outputs["BSDF"], nodes.new("ShaderNodeOutputMaterial").inputs["Surface"])
    return material


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2], int(sys.argv[3]))
