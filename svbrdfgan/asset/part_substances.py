"""What parts of an asset are made of, by their verdicts, and which of the kept ones a recipe settles on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType

import numpy as np
from jaxtyping import UInt8
from numpy import ndarray

from svbrdfgan.asset.asset import Asset
from svbrdfgan.asset.verdicts import BY_MASK, Verdict
from svbrdfgan.asset.wheels import find_wheels
from svbrdfgan.types import Mesh
from svbrdfgan.weathering.substances import Substance

_SUBSTANCES: Mapping[str, Substance] = MappingProxyType(
    {
        "trim": Substance.PLASTIC,
        "plate": Substance.PLASTIC,
        "chassis": Substance.STEEL,
        "rim": Substance.ALLOY,
        "chrome": Substance.ALLOY,
        "glass": Substance.GLASS,
        "lamp": Substance.GLASS,
        "mirror": Substance.GLASS,
        "tyre": Substance.RUBBER,
        "wheel": Substance.RUBBER,
        "rubber": Substance.RUBBER,
    }
)
"""By the kinds of verdicts; other kinds that weather are painted."""


def face_substances(asset: Asset, verdicts: Sequence[Verdict], mesh: Mesh) -> UInt8[ndarray, " faces"]:
    """The substance of each face of the asset's mesh; in wheels also by place: files paint tyres and body as one part.

    Args:
        mesh: the asset's, with its roof at +Y.
    """
    found = np.array([_SUBSTANCES.get(verdict.kind, Substance.PAINT) for verdict in verdicts], np.uint8)
    substance = found[asset.face_piece]
    height = mesh.positions[np.unique(mesh.faces), 1]
    wheels = find_wheels(mesh.positions, mesh.faces, asset.face_piece, float(height.min()), float(np.ptp(height)))
    unknown = substance == Substance.PAINT
    substance[wheels.inside & unknown] = Substance.ALLOY
    substance[wheels.tread & unknown] = Substance.RUBBER
    return substance


def settled(verdicts: Sequence[Verdict], settles_on: Mapping[Substance, float]) -> tuple[Verdict, ...]:
    """The verdicts, but what matter also lies on weathers: dust does not spare glass, and rust does.

    What the user's patterns and masks keep stays kept, as do interiors, decals and the ground.
    """
    return tuple(_settled(verdict, settles_on) for verdict in verdicts)


def _settled(verdict: Verdict, settles_on: Mapping[Substance, float]) -> Verdict:
    substance = None if verdict.reason == BY_MASK else _SUBSTANCES.get(verdict.kind)
    if verdict.weathers or substance is None or not settles_on.get(substance, 0.0):
        return verdict
    return replace(verdict, weathers=True, reason=f"{verdict.reason}; this settles on {substance.name.lower()}, too")
