"""Blender add-on: a panel in the sidebar of the 3D view that weathers the selected objects by svbrdfgan.

The add-on exports the selection as a temporary GLB, lets the program `svbrdfgan` weather it, and gives the objects the
new materials and, where the program made one, the new UV map. All else of the objects stays as it is.
"""

import functools
import importlib.util
import json
import shutil
import subprocess
import sys
import tempfile
import time
from contextlib import contextmanager
from pathlib import Path

import bpy
import numpy as np
from bpy.props import EnumProperty, FloatProperty, IntProperty, PointerProperty, StringProperty

bl_info = {"name": "svbrdfgan weathering", "version": (0, 1, 0), "blender": (4, 2, 0), "category": "Material"}
bl_info |= {"location": "3D View > Sidebar > Weathering", "description": "Weathers the selected objects"}

KEY = "svbrdfgan"  # a custom property that numbers the objects, in the temporary files alone
PAINTERS = [(name, name, f"The recipe {name}") for name in ("road-dirt", "dust", "rust", "chipped-paint", "grime")]
PAINTERS.append(("MODEL", "shipped model", "A trained model that comes with svbrdfgan"))
SIZES = [("OWN", "as it is", "The size of each material's own textures, or at most 2048 for new ones")]
SIZES += [(str(size), str(size), "Texels along the longer side") for size in (512, 1024, 2048, 4096)]
EXPORT = {"use_selection": True, "export_format": "GLB", "export_extras": True}
EXPORT |= {f"export_{name}": False for name in ("apply", "animations", "skins", "morph", "cameras", "lights")}
KINDS = ("objects", "meshes", "materials", "node_groups", "images")  # what uses others comes first
NAVIGATION = {"MIDDLEMOUSE", "MOUSEMOVE", "WHEELUPMOUSE", "WHEELDOWNMOUSE", "TRACKPADPAN", "TRACKPADZOOM"}
PERIOD = 0.2  # seconds between two looks at the program


class WeatherError(Exception):
    """One sentence for the user."""


def program(context):
    """The words that start svbrdfgan: the preference, or Blender's own Python if it has the package, or PATH."""
    if wanted := context.preferences.addons[__name__].preferences.program:
        return [bpy.path.abspath(wanted)]
    if importlib.util.find_spec("svbrdfgan"):
        return [sys.executable, "-c", "from svbrdfgan.cli import main; main()"]
    if found := shutil.which("svbrdfgan"):
        return [found]
    raise WeatherError("No program svbrdfgan was found: install it, or name its path in this add-on's preferences.")


@functools.cache
def models(*words):
    done = subprocess.run([*words, "models", "--json"], capture_output=True, timeout=60, check=True)
    return [card["name"] for card in json.loads(done.stdout)]


def shipped(_settings, context, _typed):
    """The shipped models, asked for when the user opens the field; none where the program does not answer."""
    try:
        return models(*program(context))
    except (WeatherError, OSError, subprocess.SubprocessError, ValueError):
        return []


def arguments(settings, before, after):
    words = ["weather", before, "--recipe", settings.painter]
    if settings.painter == "MODEL":
        words = ["texture", before, "--model", settings.model]
    size = [] if settings.size == "OWN" else ["--size", settings.size]
    return [*words, "--amount", f"{settings.amount:.4f}", "--seed", str(settings.seed), *size, "-o", after]


class Job:
    """The program at work on a temporary file of the selected meshes."""

    def __init__(self, context):
        words, self._folder = program(context), tempfile.TemporaryDirectory(prefix="svbrdfgan-")
        before, self._after, self._said = (Path(self._folder.name) / name for name in ("in.glb", "out.glb", "said.txt"))
        try:
            self._names = exported(context, str(before))
            words += arguments(context.scene.svbrdfgan, str(before), str(self._after))
            with self._said.open("w") as said:
                self._process = subprocess.Popen(words, stdin=subprocess.DEVNULL, stdout=said, stderr=said)
        except (OSError, RuntimeError) as error:
            self._folder.cleanup()
            raise WeatherError(f"{words[0]} cannot be run on the selected objects: {error}.") from error

    def running(self):
        return self._process.poll() is None

    def last_line(self, start=""):
        """What the program said last, or said last after a word such as Error."""
        lines = [line.strip() for line in self._said.read_text(errors="replace").splitlines()]
        return next((line.removeprefix(start) for line in reversed(lines) if line and line.startswith(start)), "")

    def deliver(self, context):
        """Gives the objects what came back; returns a sentence."""
        if self._process.returncode:
            raise WeatherError(self.last_line("Error: ") or self.last_line() or "svbrdfgan ended without a word.")
        marks, fitted = weathering(self._after), {}
        if not any(map(any, marks.values())):
            raise WeatherError("Nothing of the selected objects weathers; `svbrdfgan parts` tells why.")
        with imported(context, self._after) as made:
            for number in (number for number in made if any(marks[number])):
                adopt(bpy.data.objects[self._names[number]], made[number], marks[number], fitted)
        return f"{sum(map(any, marks.values()))} of {len(self._names)} objects weathered."

    def close(self):
        if self.running():
            self._process.kill()
        self._process.wait()
        self._folder.cleanup()


def exported(context, path):
    """Writes the selected meshes at rest and without modifiers, numbered by a property; returns their names."""
    things = [thing for thing in context.selected_objects if thing.type == "MESH"]
    try:
        for number, thing in enumerate(things):
            thing[KEY] = number
        bpy.ops.export_scene.gltf(filepath=path, **EXPORT)
    finally:
        for thing in things:
            thing.pop(KEY, None)
    return [thing.name for thing in things]


def weathering(path):
    """Of each numbered object in a file, which of its primitives weather: svbrdfgan gives new pictures no name, and
    Blender names all."""
    data = path.read_bytes()
    document = json.loads(data[20 : 20 + int.from_bytes(data[12:16], "little")])

    def weathers(primitive):
        material = document["materials"][primitive["material"]] if "material" in primitive else {}
        texture = material.get("pbrMetallicRoughness", {}).get("baseColorTexture")
        return texture is not None and "name" not in document["images"][document["textures"][texture["index"]]["source"]]

    nodes = [node for node in document["nodes"] if "mesh" in node and KEY in node.get("extras", {})]
    return {n["extras"][KEY]: [weathers(p) for p in document["meshes"][n["mesh"]]["primitives"]] for n in nodes}


@contextmanager
def imported(context, path):
    """The file's meshes by number, there for the time of the block; what nothing uses then leaves with them."""
    kinds = [getattr(bpy.data, kind) for kind in KINDS]
    before = [set(kind) for kind in kinds]
    selected, active = context.selected_objects, context.view_layer.objects.active
    try:
        bpy.ops.import_scene.gltf(filepath=str(path))
        yield {thing[KEY]: thing.data for thing in set(bpy.data.objects) - before[0] if thing.type == "MESH"}
    except RuntimeError as error:
        raise WeatherError(f"Blender cannot import the weathered objects: {error}") from error
    finally:
        for kind, old in zip(kinds, before, strict=True):
            for new in set(kind) - old:
                if kind is kinds[0] or not new.users:
                    kind.remove(new)
        for thing in selected:
            thing.select_set(True)
        context.view_layer.objects.active = active


def adopt(thing, made, marks, fitted):
    """Gives an object the materials of an imported mesh's primitives that weather, and its new UV maps."""
    if thing.data.users > 1:
        thing.data = thing.data.copy()  # others show the clean mesh
    thing.data.calc_loop_triangles()
    slots = read(thing.data.loop_triangles, "material_index", kind=np.int32)
    order = np.argsort(slots, kind="stable")  # the exporter goes by slots
    names, faces = [layer.name for layer in made.uv_layers], read(made.polygons, "material_index", kind=np.int32)
    used, first = np.unique(slots[order], return_index=True)
    if not add_uvs(thing.data, made, read(thing.data.loop_triangles, "loops", 3, np.int32)[order].ravel()):
        thing.data = triangulated(thing.data, made, slots[order])
    for slot, face, weathers in zip(used.tolist(), first, marks, strict=True):
        if weathers:
            dress(thing, slot, made.materials[faces[face]], names, fitted)


def read(items, name, width=1, kind=np.float32):
    found = np.empty((len(items), width) if width > 1 else len(items), kind)
    items.foreach_get(name, found.reshape(-1))
    return found


def add_uvs(mesh, made, corners):
    """Adds an imported mesh's further UV maps; False where its triangles are others or cut a polygon."""
    places = [read(each.vertices, "co", 3)[read(each.loops, "vertex_index", kind=np.int32)] for each in (mesh, made)]
    further = [read(layer.uv, "vector", 2) for layer in made.uv_layers[len(mesh.uv_layers) :]]
    own = [np.zeros((len(mesh.loops), 2), np.float32) for _ in further]
    if len(corners) != len(made.loops) or not np.allclose(places[0][corners], places[1], rtol=1e-4, atol=1e-5):
        return not further
    for values, given in zip(own, further, strict=True):
        values[corners] = given
    if not all(np.array_equal(values[corners], given) for values, given in zip(own, further, strict=True)):
        return False
    for values in own:
        mesh.uv_layers.new(name="Weathering", do_init=False).uv.foreach_set("vector", values.ravel())
    return True


def triangulated(mesh, made, slots):
    """The imported mesh, of triangles, with the slots of the object's own."""
    own = made.copy()
    own.materials.clear()
    for material in mesh.materials:
        own.materials.append(material)
    own.polygons.foreach_set("material_index", slots)
    return own


def dress(thing, slot, material, names, fitted):
    """Puts a copy of an imported material into a slot; each texture names its UV map as the object's mesh does."""
    if slot >= len(thing.material_slots):
        thing.data.materials.append(None)
    here, own = thing.material_slots[slot], [layer.name for layer in thing.data.uv_layers]
    key = (material, *own)
    if key not in fitted:
        fitted[key] = material.copy()
        name = here.material.name if here.material else thing.name
        fitted[key].name = f"{name.split(' weathered')[0]} weathered"
        tree = fitted[key].node_tree
        for node in [node for node in tree.nodes if node.type == "TEX_IMAGE" and not node.inputs["Vector"].is_linked]:
            first = tree.nodes.new("ShaderNodeUVMap")
            first.uv_map = names[0]
            tree.links.new(node.inputs["Vector"], first.outputs["UV"])
        for node in [node for node in tree.nodes if getattr(node, "uv_map", "") in names]:
            node.uv_map = own[names.index(node.uv_map)]
    here.material = fitted[key]


class Preferences(bpy.types.AddonPreferences):
    bl_idname = __name__
    program: StringProperty(name="svbrdfgan", subtype="FILE_PATH", description="The program; empty finds it on PATH")

    def draw(self, _context):
        self.layout.prop(self, "program")


class Settings(bpy.types.PropertyGroup):
    painter: EnumProperty(name="Painter", items=PAINTERS)
    model: StringProperty(name="Model", default="road-dirt", search=shipped)
    amount: FloatProperty(name="Amount", default=0.6, min=0, max=1, subtype="FACTOR", description="0 is clean")
    seed: IntProperty(name="Seed", min=0, description="Each seed gives another pattern")
    size: EnumProperty(name="Texture size", items=SIZES)


class Weather(bpy.types.Operator):
    """Export the selected objects, let svbrdfgan weather them, and give them what comes back"""

    bl_idname, bl_label, bl_options = "svbrdfgan.weather", "Weather the selected objects", {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context):
        return context.mode == "OBJECT" and any(thing.type == "MESH" for thing in context.selected_objects)

    def execute(self, context):
        return self._tried(context, self._waited)

    def invoke(self, context, _event):
        return self._tried(context, self._waited if bpy.app.background else self._began)

    def modal(self, context, event):
        """Looks at the program; the view may be turned meanwhile, and the scene stays as it was exported."""
        if event.type == "TIMER" and self._job.running():
            self._ticks += 1
            context.window_manager.progress_update(self._ticks % 100)
            context.workspace.status_text_set(f"Weathering (Esc cancels): {self._job.last_line()}")
        elif event.type in ("ESC", "TIMER"):
            context.window_manager.event_timer_remove(self._timer)
            context.workspace.status_text_set(None)
            return self._tried(context, self._cancelled if event.type == "ESC" else self._delivered)
        return {"PASS_THROUGH"} if event.type in NAVIGATION else {"RUNNING_MODAL"}

    def _tried(self, context, step):
        try:
            return step(context)
        except WeatherError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}

    def _began(self, context):
        self._job, self._ticks, manager = Job(context), 0, context.window_manager
        self._timer = manager.event_timer_add(PERIOD, window=context.window)
        manager.progress_begin(0, 100)
        manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def _waited(self, context):
        self._job = Job(context)
        context.window_manager.progress_begin(0, 1)
        while self._job.running():
            time.sleep(PERIOD)
        return self._delivered(context)

    def _delivered(self, context):
        try:
            self.report({"INFO"}, self._job.deliver(context))
        finally:
            self._cancelled(context)
        return {"FINISHED"}

    def _cancelled(self, context):
        context.window_manager.progress_end()
        self._job.close()
        return {"CANCELLED"}


class Panel(bpy.types.Panel):
    bl_idname, bl_label, bl_category = "VIEW3D_PT_svbrdfgan", "Weathering", "Weathering"
    bl_space_type, bl_region_type = "VIEW_3D", "UI"

    def draw(self, context):
        settings = context.scene.svbrdfgan
        for name in ("painter", *(["model"] if settings.painter == "MODEL" else []), "amount", "seed", "size"):
            self.layout.prop(settings, name)
        self.layout.operator(Weather.bl_idname, icon="BRUSH_DATA")


CLASSES = (Preferences, Settings, Weather, Panel)


def register():
    for each in CLASSES:
        bpy.utils.register_class(each)
    bpy.types.Scene.svbrdfgan = PointerProperty(type=Settings)


def unregister():
    del bpy.types.Scene.svbrdfgan
    for each in reversed(CLASSES):
        bpy.utils.unregister_class(each)
