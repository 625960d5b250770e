"""Vehicle meshes from parameters: loft the body, cut glass, lights and trim into it, add wheels and mirrors."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from svbrdfgan.procedural import regions
from svbrdfgan.procedural.carve import cut, join, sink, vertex_normals, weld
from svbrdfgan.procedural.loft import loft
from svbrdfgan.procedural.outline import Outline
from svbrdfgan.procedural.shape import VehicleShape
from svbrdfgan.procedural.wheel import mirror, wheel
from svbrdfgan.types import FileMap, Mesh, Part

PART_NAMES = ("body", "glass", "tyre", "rim", "trim", "lights_front", "lights_rear")
"""The parts of every procedural vehicle, in order. Only the body has the paint."""

BODY, GLASS, TYRE, RIM, TRIM, LIGHTS_FRONT, LIGHTS_REAR = range(len(PART_NAMES))

_COLORS = (
    (0.02, 0.03, 0.035),
    (0.02, 0.02, 0.02),
    (0.45, 0.45, 0.47),
    (0.03, 0.03, 0.03),
    (0.62, 0.62, 0.60),
    (0.45, 0.02, 0.015),
)
_GLOSS: tuple[Mapping[str, float], ...] = (
    {"roughness": 0.15, "metallic": 0.0},  # a clear coat
    {"roughness": 0.05, "metallic": 0.0, "alpha": 0.7},  # tinted
    {"roughness": 0.9, "metallic": 0.0},
    {"roughness": 0.3, "metallic": 1.0},
    {"roughness": 0.6, "metallic": 0.0},
    {"roughness": 0.1, "metallic": 0.0},
    {"roughness": 0.1, "metallic": 0.0},
)
"""Of each part, in the order of `PART_NAMES`, as a mesh's file would say it: `make_subject` tells who reads it."""
_RECESS = 0.004  # depth of the glass below the body's surface
_SIDES = (1.0, -1.0)
_REGIONS = (
    (GLASS, regions.windscreen),
    (GLASS, regions.side_windows),
    (GLASS, regions.rear_window),
    (LIGHTS_FRONT, regions.headlights),
    (LIGHTS_REAR, regions.tail_lights),
    (TRIM, regions.grille),
    (TRIM, regions.cladding),
)


def build_vehicle(shape: VehicleShape) -> Mesh:
    """The vehicle's mesh: nose at +Z, ground at y = 0, centred in x and z, length 1, 6,000 to 8,000 faces, no UVs.

    The body with its glass, lights and trim is one closed surface; each wheel and each mirror is another. Paint is
    glossy, rims are metal, and glass is seen through, where maps besides base colour are rendered.
    """
    outline = Outline(shape)
    body = _skin(outline)
    for part, region in _REGIONS:
        body, inside = cut(body, region(outline)(body.positions))
        chosen = inside & (body.face_part == BODY)
        body = replace(body, face_part=np.where(chosen, part, body.face_part))
        if part == GLASS:
            body = sink(body, chosen, -_RECESS * vertex_normals(body), wall=TRIM)
    if shape.open_bed:
        body = _with_bed(body, outline)
    body = replace(body, positions=outline.bowed(body.positions))
    return _standing(weld(join([body, *_wheels(body, outline), *_mirrors(body, outline)])))


def _skin(outline: Outline) -> Mesh:
    """The uncut body. All of it is painted, except the underside, which is trim."""
    extra = np.concatenate([outline.arch_stations(11), regions.pillar_stations(outline)])
    positions, faces, under = loft(outline, extra)
    colors = (outline.shape.paint, *_COLORS)
    parts = tuple(
        Part(name, color, file_maps={key: FileMap((value,)) for key, value in gloss.items()})
        for name, color, gloss in zip(PART_NAMES, colors, _GLOSS, strict=True)
    )
    return weld(Mesh(positions, faces, np.where(under, TRIM, BODY), parts))


def _with_bed(body: Mesh, outline: Outline) -> Mesh:
    """The body with a load bed sunk into it. Boxes over the wheels stay above the bed's floor."""
    opening, boxes = regions.bed(outline), regions.wheel_boxes(outline)
    for wall in (0.0, 0.006):  # two cuts: the foot and the top of the boxes' walls
        body, _ = cut(body, np.maximum(opening(body.positions), boxes(body.positions) + wall))
    body, inside = cut(body, opening(body.positions))
    floor = outline.shape.clearance + 0.45 * (outline.landmarks[1, 1] - outline.shape.clearance)
    over_wheels = np.where(boxes(body.positions) < -0.005, outline.low(body.positions[:, 2]) + 0.01, floor)
    offset = np.zeros_like(body.positions)
    offset[:, 1] = np.maximum(floor, over_wheels) - body.positions[:, 1]
    return sink(body, inside & (body.face_part == BODY), offset, wall=BODY)


def _wheels(body: Mesh, outline: Outline) -> list[Mesh]:
    shape = outline.shape
    positions, faces, names = wheel(shape.wheel_radius, shape.wheel_width)
    part = np.array([PART_NAMES.index(name) for name in names])
    wheels = []
    for axle in shape.axles:
        edge = float(outline.half_width(np.array(axle), np.array(shape.wheel_radius)))
        at = outline.bowed(np.array([(edge - 0.5 * shape.wheel_width - 0.004, shape.wheel_radius, axle)]))
        wheels += [_mirrored(Mesh(positions + at, faces, part, body.parts), side) for side in _SIDES]
    return wheels


def _mirrors(body: Mesh, outline: Outline) -> list[Mesh]:
    cowl = outline.landmarks[5]
    z, y = cowl[0] - 0.30 * outline.shape.windscreen_run, cowl[1] + 0.018
    positions, faces = mirror(0.022)
    edge = float(outline.half_width(np.array(z), np.array(y)))
    at = outline.bowed(np.array([(edge + 0.012, y, z)]))
    egg = Mesh(positions + at, faces, np.full(len(faces), BODY), body.parts)
    return [_mirrored(egg, side) for side in _SIDES]


def _mirrored(mesh: Mesh, side: float) -> Mesh:
    """The mesh scaled by `side` (1 or -1) along x."""
    faces = mesh.faces if side > 0 else mesh.faces[:, ::-1]  # mirroring reverses the winding
    return replace(mesh, positions=mesh.positions * (side, 1.0, 1.0), faces=faces)


def _standing(mesh: Mesh) -> Mesh:
    """The mesh placed on the ground, centred in x and z, and scaled to length 1."""
    low, high = mesh.bounds
    middle = (0.5 * (low[0] + high[0]), low[1], 0.5 * (low[2] + high[2]))
    return replace(mesh, positions=(mesh.positions - middle) / (high[2] - low[2]))
