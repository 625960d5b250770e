"""Weathers a square; prints the estimated and the measured peak of this process's memory, in bytes.

`weather_square.py FOLDER SIZE PAINTED OLD DIVISIONS`
"""

import resource
import sys
from io import BytesIO
from pathlib import Path

import numpy as np
from PIL import Image

from svbrdfgan.asset.asset import load_asset
from svbrdfgan.asset.memory import Plan
from svbrdfgan.asset.painted_texture import Model
from svbrdfgan.asset.painters import RecipePainter
from svbrdfgan.asset.surroundings import Surroundings
from svbrdfgan.asset.weather_document import Textures, weather_document
from svbrdfgan.io.gltf.accessors import append_accessor
from svbrdfgan.io.gltf.document import Document, write_document
from svbrdfgan.io.gltf_codecs.plain import INDICES
from svbrdfgan.weathering.recipes import Dust


def square(path: Path, divisions: int, old: int) -> None:
    """Writes a square of 2 x divisions^2 triangles, with three textures of that size over it twice."""
    document = Document({"asset": {"version": "2.0"}}, [], path)
    stream = BytesIO()
    Image.fromarray(np.random.default_rng(0).integers(0, 255, (old, old, 3), np.uint8)).save(stream, format="PNG")
    for _ in range(3):
        image = {"bufferView": document.add_view(stream.getvalue()), "mimeType": "image/png"}
        document.add("textures", {"source": document.add("images", image)})
    gloss = {"baseColorTexture": {"index": 0}, "metallicRoughnessTexture": {"index": 1}}
    document.add("materials", {"name": "paint", "pbrMetallicRoughness": gloss, "normalTexture": {"index": 2}})
    line = np.linspace(0.0, 1.0, divisions + 1)
    x, z = (values.ravel() for values in np.meshgrid(line, line))
    corner = (np.arange(divisions)[:, None] * (divisions + 1) + np.arange(divisions)).ravel()
    faces = corner[:, None] + np.array([0, divisions + 2, 1, 0, divisions + 1, divisions + 2])
    attributes = {
        "POSITION": append_accessor(document, np.column_stack([x, 0.0 * x, z]).astype("<f4"), bounds=True),
        "TEXCOORD_0": append_accessor(document, np.column_stack([np.abs(2.0 * x - 1.0), z]).astype("<f4")),
    }
    index = append_accessor(document, faces.ravel().astype("<u4"), target=INDICES)
    primitive = {"attributes": attributes, "indices": index, "material": 0}
    document.add("nodes", {"mesh": document.add("meshes", {"primitives": [primitive]})})
    write_document(path, document)


def held() -> int:
    """The most bytes that this process held; `ru_maxrss` would be that of its parent, if that held more."""
    try:
        lines = Path("/proc/self/status").read_text(encoding="ascii").splitlines()
        return next(int(line.split()[1]) << 10 for line in lines if line.startswith("VmHWM:"))
    except (OSError, StopIteration):
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss << 10


def main(folder: str, *numbers: str) -> None:
    size, painted, old, divisions = map(int, numbers)
    path, textures = Path(folder) / "square.glb", Textures(size, painted)
    square(path, divisions, old)
    asset = load_asset(path)
    around = Surroundings.of(asset.mesh)
    painter = RecipePainter(around, Dust(amount=1.0))
    edited = weather_document(asset, Model(asset.mesh, around.reversed), painter, {0}, textures)
    write_document(Path(folder) / "weathered.glb", edited.document)
    plan = Plan.of(asset, {0}, textures)
    print(plan.peak_bytes(), held())


if __name__ == "__main__":
    main(*sys.argv[1:])
