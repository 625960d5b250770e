"""Kinds of files that other programs pack or that training stores: Draco, KTX2, cameras, checkpoints, transports."""

from __future__ import annotations

import json
import shutil
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import torch

from svbrdfgan.data.photos.captures import expand_captures
from svbrdfgan.data.photos.check import ErrorCollector
from svbrdfgan.data.photos.manifest import read_manifest
from svbrdfgan.io.gltf_codecs.pictures import KTX2
from svbrdfgan.rendering.transport.light_transport import LightTransport
from svbrdfgan.training.config import train_config
from svbrdfgan.training.state import State, load_discriminator
from tests.fuzz.kinds import Kind, _gathered
from tests.fuzz.trees import packed_glb

_QUAD = Path(__file__).parents[1] / "io" / "gltf_codecs" / "quad.drc"
_COUNTERS = {"step": 1, "seconds": 2.5, "best": [1.5, 1], "history": []}
_LENSES = {"SIMPLE_PINHOLE": (0, (50, 16, 12)), "PINHOLE": (1, (50, 51, 16, 12))}
_LENSES |= {"OPENCV": (4, (50, 51, 16, 12, 0.1, 0.01, 0.001, 0.002))}
_POSE = (0.9, 0.1, -0.2, 0.3, 0.5, -0.4, 4.0)


def stored_kinds(files: Path) -> dict[str, Kind]:
    """The kinds, by name; `files` has a picture, and gets what lies beside."""
    folder = files / "stored"
    folder.mkdir()
    shutil.copy(files / "picture.png", folder / "a.png")
    (folder / "state.json").write_text(json.dumps(_COUNTERS))
    _transport().save(folder / "transport.safetensors")
    _transport().half().save(folder / "half.safetensors")
    transports = tuple((folder / name).read_bytes() for name in ("transport.safetensors", "half.safetensors"))
    draco, ktx2 = _QUAD.read_bytes(), _ktx2()
    return {
        "weights": Kind("state.safetensors", (_checkpoint(folder),), _resumed, (folder / "state.json",)),
        "transport": Kind("a.safetensors", transports, LightTransport.load),
        "draco": Kind("mesh.drc", (draco,), _inside(lambda data: _glb(data, ktx2))),
        "ktx2": Kind("picture.ktx2", (ktx2,), _inside(lambda data: _glb(draco, data))),
        "packed-glb": Kind("mesh.glb", (_glb(draco, ktx2),), _gathered),
        **_cameras(folder),
    }


def _cameras(folder: Path) -> dict[str, Kind]:
    """COLMAP's files of cameras and of pictures, of text and binary."""
    values = " ".join(map(str, _POSE))
    lenses = _LENSES.items()
    pack = struct.pack
    contents = {
        "cameras.txt": "".join(f"{k} {name} 32 24 {' '.join(map(str, v))}\n" for name, (k, v) in lenses).encode(),
        "images.txt": "".join(f"{k + 1} {values} {k} a.png\n1 2 3\n" for k in (4,)).encode(),
        "cameras.bin": pack("<Q", len(_LENSES))
        + b"".join(pack(f"<iiQQ{len(v)}d", k, k, 32, 24, *v) for _, (k, v) in lenses),
        "images.bin": pack("<QI7dI", 1, 1, *_POSE, 4) + b"a.png\0" + pack("<Q2dQ", 1, 3.0, 4.0, 5),
    }
    for name, data in contents.items():
        (folder / name).write_bytes(data)
    others = {"cameras": "images", "images": "cameras"}
    return {
        f"colmap-{name.replace('.', '-')}": Kind(
            name, (data,), _captured, (folder / f"{others[Path(name).stem]}{Path(name).suffix}", folder / "a.png")
        )
        for name, data in contents.items()
    }


def _captured(path: Path) -> None:
    """What `svbrdfgan dataset import` does with the cameras of another program."""
    manifest = {"captures": [{"cameras": ".", "images": ".", "mesh": "a.glb"}], "paint": {"a.glb": [0.4, 0.1, 0.1]}}
    errors = ErrorCollector("manifest.yaml")
    expand_captures(read_manifest(manifest, "manifest.yaml"), path.parent, errors)
    errors.raise_if_any()


def _inside(made: Callable[[bytes], bytes]) -> Callable[[Path], None]:
    """Reads a GLB that holds the file."""

    def read(path: Path) -> None:
        whole = path.with_name("holds-it.glb")
        whole.write_bytes(made(path.read_bytes()))
        _gathered(whole)

    return read


def _glb(draco: bytes, ktx2: bytes) -> bytes:
    """A quad by Draco whose texture is a KTX2."""
    packing = {"bufferView": 0, "attributes": {"POSITION": 0, "JOINTS_0": 2}}
    primitive = {
        "attributes": {"POSITION": 0, "JOINTS_0": 1},
        "indices": 2,
        "material": 0,
        "extensions": {"KHR_draco_mesh_compression": packing},
    }
    first = draco + b"\0" * (-len(draco) % 4)
    binary = first + ktx2 + b"\0" * (-len(ktx2) % 4)
    header: dict[str, Any] = {
        "asset": {"version": "2.0"},
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [primitive]}],
        "materials": [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}],
        "textures": [{"extensions": {"KHR_texture_basisu": {"source": 0}}}],
        "images": [{"bufferView": 1, "mimeType": "image/ktx2"}],
        "accessors": [
            {"componentType": 5122, "count": 4, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 1]},
            {"componentType": 5121, "count": 4, "type": "VEC4"},
            {"componentType": 5121, "count": 6, "type": "SCALAR"},
        ],
        "bufferViews": [
            {"buffer": 0, "byteLength": len(draco)},
            {"buffer": 0, "byteOffset": len(first), "byteLength": len(ktx2)},
        ],
        "buffers": [{"byteLength": len(binary)}],
        "extensionsUsed": ["KHR_draco_mesh_compression", "KHR_texture_basisu"],
    }
    return packed_glb(json.dumps(header).encode(), len(binary).to_bytes(4, "little") + b"BIN\0" + binary)


def _ktx2() -> bytes:
    import zstandard

    pixels = np.random.default_rng(5).integers(0, 256, (8, 8, 4), dtype=np.uint8).tobytes()
    level = zstandard.compress(pixels)
    head = KTX2 + struct.pack("<9I", 43, 1, 8, 8, 0, 0, 1, 1, 2) + bytes(32)
    return head + struct.pack("<3Q", 104, len(level), len(pixels)) + level


def _config() -> Any:
    small = {"generator": {"width": 4, "blocks": 1}, "discriminator": {"width": 4, "layers": 1}}
    return train_config({"dataset": "a", **small}, "seed")


def _checkpoint(folder: Path) -> bytes:
    """The tensors of a checkpoint after one step."""
    state = State.fresh(_config(), torch.device("cpu"))
    for adam in (state.generator_adam, state.discriminator_adam):
        for parameter in adam.param_groups[0]["params"]:
            parameter.grad = torch.zeros_like(parameter)
        adam.step()
    state.step = 1
    state.save(folder)
    return (folder / "checkpoints" / "step_00000001" / "state.safetensors").read_bytes()


def _resumed(path: Path) -> None:
    """What `svbrdfgan train` does with a checkpoint, and what scores do with its discriminator."""
    folder = path.parent / "step_00000001"
    folder.mkdir(exist_ok=True)
    for name in ("state.safetensors", "state.json"):
        shutil.copy(path.with_name(name), folder)
    State.fresh(_config(), torch.device("cpu")).load(folder)
    load_discriminator(folder, _config().discriminator)


def _transport() -> LightTransport:
    random, count = torch.Generator().manual_seed(5), torch.tensor([0, 3, 1, 0, 2, 6])
    return LightTransport(
        start=torch.cat([torch.zeros(1, dtype=torch.long), count.cumsum(0)]).int(),
        texel=torch.cat([torch.arange(int(n)) for n in count]).int(),
        weight=torch.rand(12, 3, generator=random),
        scale=torch.tensor(0.5),
        background=torch.rand(2, 3, 3, generator=random),
        coverage=torch.rand(2, 3, generator=random),
        gbuffer=torch.rand(2, 3, 6, generator=random),
        parts=(0, 2),
        texture_shape=(4, 4),
    )
