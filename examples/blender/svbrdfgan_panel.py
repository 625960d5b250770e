"""Blender add-on: a panel that weathers the selected objects in place, by `svbrdfgan` and a temporary GLB."""

import functools
import importlib.util
import json
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import bpy
import numpy as np
from bpy.props import EnumProperty, FloatProperty, IntProperty, StringProperty

bl_info = {"name": "svbrdfgan weathering", "version": (0, 1, 0), "blender": (4, 2, 0), "category": "Material"}
KEY = "svbrdfgan"  # a custom property that numbers the objects, in the temporary files alone
PAINTERS = [(name, name, f"The recipe {name}") for name in ("road-dirt", "dust", "rust", "chipped-paint", "grime")]
PAINTERS.append(("MODEL", "shipped model", "A trained model that comes with svbrdfgan"))
OFF = {f"export_{name}": False for name in ("apply", "animations", "skins", "morph", "cameras", "lights")}


def preferences(context):
    return context.preferences.addons[__name__].preferences


def program(context):
    """The words that start svbrdfgan: the preference, or Blender's own Python if it has the package, or PATH."""
    if not preferences(context).program and importlib.util.find_spec("svbrdfgan"):
        return [sys.executable, "-m", "svbrdfgan"]
    if found := bpy.path.abspath(preferences(context).program) or shutil.which("svbrdfgan"):
        return [found]
    raise RuntimeError("No program svbrdfgan was found: install it, or name its path in this add-on's preferences.")


@functools.cache
def models(*words):
    return [card["name"] for card in json.loads(subprocess.check_output([*words, "models", "--json"], timeout=60))]


def weathered(context):
    """Weathers the selected meshes: yields what the program said last while it works, and returns a sentence."""
    with tempfile.TemporaryDirectory(prefix="svbrdfgan-") as folder:
        before, after, said = (Path(folder) / name for name in ("in.glb", "out.glb", "said.txt"))
        words = [*program(context), *preferences(context).arguments(), str(before), "-o", str(after)]
        names = exported(context, before)
        try:
            with said.open("w") as out:
                process = subprocess.Popen(words, stdin=subprocess.DEVNULL, stdout=out, stderr=out)
        except OSError as error:
            raise RuntimeError(f"The program {words[0]} cannot be run: {error.strerror}.") from error
        try:
            while process.poll() is None:
                yield said.read_text(errors="replace").strip().rpartition("\n")[2]
        finally:  # also if the user cancels
            process.kill()
            process.wait()
        if process.returncode:
            last = said.read_text(errors="replace").strip().rpartition("\n")[2]
            raise RuntimeError(last.removeprefix("Error: ") or "svbrdfgan ended without a word.")
        return deliver(context, names, before, after)


def exported(context, path):
    """Writes the selected meshes at rest and without modifiers, numbered by a property; returns their names."""
    things = [thing for thing in context.selected_objects if thing.type == "MESH"]
    grey = bpy.data.materials.new("grey")  # of bare objects: glTF's own default is a white metal
    try:
        for number, thing in enumerate(things):
            thing[KEY] = number
            if not thing.data.materials:
                thing.data.materials.append(grey)
        bpy.ops.export_scene.gltf(filepath=str(path), use_selection=True, export_extras=True, **OFF)
    finally:
        for thing in things:
            thing.pop(KEY, None)
            if grey in thing.data.materials.values():
                thing.data.materials.clear()
        bpy.data.materials.remove(grey)
    return [thing.name for thing in things]


def deliver(context, names, clean, path):
    """Gives the objects of these names what is in the file; what nothing uses of it leaves again."""
    old, new = pictures(clean), pictures(path)
    marks = {key: [a != b for a, b in zip(old[key], new[key], strict=True)] for key in old}
    marks = {key: each for key, each in marks.items() if any(each)}
    if not marks:
        raise RuntimeError("Nothing of the selected objects weathers; `svbrdfgan parts` tells why.")
    before = {kind: set(getattr(bpy.data, kind)) for kind in ("objects", "meshes", "materials", "images")}
    selected, active, fitted = context.selected_objects, context.view_layer.objects.active, {}
    try:
        bpy.ops.import_scene.gltf(filepath=str(path))
        for new in set(bpy.data.objects) - before["objects"]:
            if new.get(KEY) in marks:
                adopt(bpy.data.objects[names[new[KEY]]], new.data, marks[new[KEY]], fitted)
    finally:
        for kind, old in before.items():
            for new in set(getattr(bpy.data, kind)) - old:
                if kind == "objects" or not new.users:
                    getattr(bpy.data, kind).remove(new)
        for thing in selected:
            thing.select_set(True)
        context.view_layer.objects.active = active
    return f"{len(marks)} of {len(names)} objects weathered."


def pictures(path):
    """Of each numbered object in a file, the picture of each primitive's base colour, or None."""
    data = memoryview(path.read_bytes())
    end = 20 + int.from_bytes(data[12:16], "little")
    document, data = json.loads(bytes(data[20:end])), data[end + 8 :]
    views = [data[each.get("byteOffset", 0) :][: each["byteLength"]] for each in document["bufferViews"]]
    textures, materials, images = (document.get(name, []) for name in ("textures", "materials", "images"))
    shown = [views[images[each["source"]]["bufferView"]] if "source" in each else each for each in textures]
    infos = [each.get("pbrMetallicRoughness", {}).get("baseColorTexture") for each in materials]
    colors, meshes = [*(info and shown[info["index"]] for info in infos), None], document.get("meshes", [])
    nodes = [node for node in document["nodes"] if "mesh" in node and KEY in node.get("extras", {})]
    return {n["extras"][KEY]: [colors[p.get("material", -1)] for p in meshes[n["mesh"]]["primitives"]] for n in nodes}


def adopt(thing, made, marks, fitted):
    """Gives an object the materials of an imported mesh's primitives that weather, and its new UV maps."""
    if thing.data.users > 1:
        thing.data = thing.data.copy()  # others show the clean mesh
    thing.data.calc_loop_triangles()
    slots = read(thing.data.loop_triangles, "material_index", kind=np.int32)
    order = np.argsort(slots, kind="stable")  # as the exporter orders triangles
    corners = read(thing.data.loop_triangles, "loops", 3, np.int32)[order].ravel()
    names, faces = [layer.name for layer in made.uv_layers], read(made.polygons, "material_index", kind=np.int32)
    thing.data = with_uvs(thing.data, made, corners, slots[order])
    used, first = np.unique(slots[order], return_index=True)
    for slot, face, weathers in zip(used.tolist(), first, marks, strict=True):
        if weathers:
            dress(thing, slot, made.materials[faces[face]], names, fitted)


def read(items, name, width=1, kind=np.float32):
    found = np.empty((len(items), width) if width > 1 else len(items), kind)
    items.foreach_get(name, found.reshape(-1))
    return found


def with_uvs(mesh, made, corners, slots):
    """The mesh, with the further UV maps of an imported one; the latter if its triangles are others or cut polygons."""
    places = [read(each.vertices, "co", 3)[read(each.loops, "vertex_index", kind=np.int32)] for each in (mesh, made)]
    same = len(corners) == len(places[1]) and np.allclose(places[0][corners], places[1], rtol=1e-4, atol=1e-5)
    given = [read(layer.uv, "vector", 2) for layer in made.uv_layers[len(mesh.uv_layers) :]]
    first = np.unique(corners, return_index=True)[1]
    own = [each[first] for each in given if same and len(first) == len(mesh.loops)]
    if len(own) == len(given) and all(np.array_equal(a[corners], b) for a, b in zip(own, given, strict=True)):
        for values in own:
            mesh.uv_layers.new(name="Weathering", do_init=False).uv.foreach_set("vector", values.ravel())
        return mesh
    other = made.copy()
    other.materials.clear()
    for material in mesh.materials:
        other.materials.append(material)
    other.polygons.foreach_set("material_index", slots)
    return other


def dress(thing, slot, material, names, fitted):
    """Puts a copy of an imported material into a slot, with the names that UV maps have in the object's own mesh."""
    if slot >= len(thing.material_slots):
        thing.data.materials.append(None)
    here, own = thing.material_slots[slot], [layer.name for layer in thing.data.uv_layers]
    if (material, *own) not in fitted:
        new = fitted[(material, *own)] = material.copy()
        new.name = f"{(here.material or thing).name.split(' weathered')[0]} weathered"
        for node in [node for node in new.node_tree.nodes if getattr(node, "uv_map", "") in names]:
            node.uv_map = own[names.index(node.uv_map)]
    here.material = fitted[(material, *own)]


class Preferences(bpy.types.AddonPreferences):
    bl_idname = __name__
    program: StringProperty(name="svbrdfgan", subtype="FILE_PATH", description="The program; empty finds it on PATH")
    painter: EnumProperty(name="Painter", items=PAINTERS)
    model: StringProperty(name="Model", default="road-dirt", search=lambda _self, context, _: models(*program(context)))
    amount: FloatProperty(name="Amount", default=0.6, min=0, max=1, subtype="FACTOR", description="0 is clean")
    seed: IntProperty(name="Seed", min=0, description="Each seed gives another pattern")
    size: IntProperty(name="Texture size", min=0, max=8192, description="0 keeps that of each material's own textures")

    def arguments(self):
        words = ["weather", "--recipe", self.painter] if self.painter != "MODEL" else ["texture", "--model", self.model]
        size = ["--size", str(self.size)] if self.size else []
        return [*words, *size, "--amount", f"{self.amount:.4f}", "--seed", str(self.seed)]

    def draw(self, _context):
        self.layout.prop(self, "program")


class Weather(bpy.types.Operator):
    """Export the selected objects, let svbrdfgan weather them, and give them what comes back"""

    bl_idname, bl_label, bl_options = "svbrdfgan.weather", "Weather the selected objects", {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context):
        return context.mode == "OBJECT" and any(thing.type == "MESH" for thing in context.selected_objects)

    def execute(self, context):
        self._work = weathered(context)
        while (state := self._step()) == {"RUNNING_MODAL"}:
            time.sleep(0.2)
        return state

    def invoke(self, context, _event):
        self._work = weathered(context)
        self._timer = context.window_manager.event_timer_add(0.2, window=context.window)
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context, event):
        if event.type not in ("TIMER", "ESC"):
            return {"PASS_THROUGH"} if event.type.startswith(("MIDDLE", "WHEEL", "TRACKPAD")) else {"RUNNING_MODAL"}
        state = self._step() if event.type == "TIMER" else {"CANCELLED"}
        context.workspace.status_text_set(f"Weathering, Esc ends: {self._said}" if state == {"RUNNING_MODAL"} else None)
        if state != {"RUNNING_MODAL"}:
            self._work.close()
            context.window_manager.event_timer_remove(self._timer)
        return state

    def _step(self):
        try:
            self._said = next(self._work)
            return {"RUNNING_MODAL"}
        except StopIteration as end:
            self.report({"INFO"}, end.value)
            return {"FINISHED"}
        except RuntimeError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}


class Panel(bpy.types.Panel):
    bl_idname, bl_label, bl_category = "VIEW3D_PT_svbrdfgan", "Weathering", "Weathering"
    bl_space_type, bl_region_type = "VIEW_3D", "UI"

    def draw(self, context):
        shown = preferences(context)
        for name in ("painter", *(["model"] if shown.painter == "MODEL" else []), "amount", "seed", "size"):
            self.layout.prop(shown, name)
        self.layout.operator(Weather.bl_idname)


register, unregister = bpy.utils.register_classes_factory((Preferences, Weather, Panel))
