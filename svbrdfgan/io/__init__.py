"""Read and write meshes, textures, images and environments. Only this package handles sRGB and file row order."""

from svbrdfgan.io.atomic import atomic_path
from svbrdfgan.io.environment import load_environment, save_environment
from svbrdfgan.io.exr import load_exr, save_exr
from svbrdfgan.io.gltf import save_glb, save_mesh_glb
from svbrdfgan.io.image import (
    linear_from_srgb,
    load_image,
    load_texture,
    luminance,
    save_codes,
    save_image,
    save_texture,
    srgb_from_linear,
)
from svbrdfgan.io.mesh import load_mesh

__all__ = [
    "atomic_path",
    "linear_from_srgb",
    "load_environment",
    "load_exr",
    "load_image",
    "load_mesh",
    "load_texture",
    "luminance",
    "save_codes",
    "save_environment",
    "save_exr",
    "save_glb",
    "save_image",
    "save_mesh_glb",
    "save_texture",
    "srgb_from_linear",
]
