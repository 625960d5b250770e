"""Procedural vehicles, skies and rooms: each is generated from a seed, so no download is needed."""

from svbrdfgan.procedural.kinds import KINDS, sample_vehicle
from svbrdfgan.procedural.room import build_room
from svbrdfgan.procedural.shape import VehicleShape
from svbrdfgan.procedural.sky import SkyParameters, build_sky, sample_sky
from svbrdfgan.procedural.vehicle import PART_NAMES, build_vehicle

__all__ = [
    "KINDS",
    "PART_NAMES",
    "SkyParameters",
    "VehicleShape",
    "build_room",
    "build_sky",
    "build_vehicle",
    "sample_sky",
    "sample_vehicle",
]
