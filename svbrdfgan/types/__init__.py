"""The records that all parts of the project exchange. They hold data and check it, and do nothing else."""

from svbrdfgan.types.geometry import FileMap, Mesh, Part, Surface
from svbrdfgan.types.layer import FURTHER_MAPS, RGBA, Layer, channel_slices, layer_channels
from svbrdfgan.types.material import CHANNELS, DIELECTRIC_REFLECTANCE, LEAST_ROUGHNESS, Material, Materials
from svbrdfgan.types.render import Gradients, Rendering, TransportSamples
from svbrdfgan.types.view import Camera, Environment, View

__all__ = [
    "CHANNELS",
    "DIELECTRIC_REFLECTANCE",
    "FURTHER_MAPS",
    "LEAST_ROUGHNESS",
    "RGBA",
    "Camera",
    "Environment",
    "FileMap",
    "Gradients",
    "Layer",
    "Material",
    "Materials",
    "Mesh",
    "Part",
    "Rendering",
    "Surface",
    "TransportSamples",
    "View",
    "channel_slices",
    "layer_channels",
]
