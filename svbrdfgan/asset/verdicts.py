"""Which parts of an asset weather, judged by what they are: the verdict on each piece, and what to warn of."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from types import MappingProxyType

from svbrdfgan.asset.asset import Asset
from svbrdfgan.asset.part_facts import Facts, Orientation, part_facts
from svbrdfgan.asset.part_rules import Context, Judgement, judge_part
from svbrdfgan.asset.part_words import shades
from svbrdfgan.geometry.normals import face_areas

_PAINTED = 0.8
"""Share of one material from which on glass is likely to be painted into its texture."""
_KEPT = "kept"
BY_MASK = "the mask"
"""The reason of verdicts that the user's masks gave."""


@dataclass(frozen=True)
class Verdict:
    """What one piece of an asset is, and whether it weathers.

    Attributes:
        piece: index into the asset's pieces.
        name: of the material, the mesh and the node, joined by " / ".
        kind: such as paint, body, trim, chassis, glass, lamp, tyre, rim, wheel, chrome, interior, plate, ground.
        reason: one short clause.
        area: share of the asset's area.
        sure: whether more than a doubtful name or its looks tell.
    """

    piece: int
    name: str
    weathers: bool
    kind: str
    reason: str
    area: float
    sure: bool


def judge(
    asset: Asset,
    *,
    orientation: Orientation | None = None,
    learnable: Sequence[str] = (),
    keep: Sequence[str] = (),
    masked: Mapping[int, bool] = MappingProxyType({}),
) -> tuple[Verdict, ...]:
    """One verdict for each piece of the asset, in their order; pieces without faces are kept.

    Patterns are shell patterns over names of materials, meshes and nodes, case ignored.

    Args:
        orientation: turns the file's axes to Y up and the nose at +Z; None if the file has them so.
        learnable: what these match weathers, whatever it is; other parts are judged as without it.
        keep: what these match is kept, whatever else is asked for.
        masked: of pieces that a mask of the user's lies on, whether it lets them weather.
    """
    parts = part_facts(asset, orientation)
    names = {name for facts in parts for name in facts.names}
    context = Context(shades(names), any(facts.wheel for facts in parts))
    judged = {
        piece: (facts, _masked(judgement, masked.get(piece)))
        for facts in parts
        for judgement in [_asked(asset, facts, learnable, keep) or judge_part(facts, context)]
        for piece in facts.pieces
    }
    shares = _shares(asset)
    return tuple(_verdict(asset, piece, judged.get(piece), shares[piece]) for piece in range(len(asset.pieces)))


def warnings(verdicts: Sequence[Verdict], asset: Asset) -> list[str]:
    """Sentences on what the user should look at before the asset is weathered."""
    found = []
    weathered = sum(verdict.area for verdict in verdicts if verdict.weathers)
    if weathered == 0.0:
        found.append(f"nothing of {asset.path.name} weathers; name the parts that should with --learnable PATTERN.")
        return found
    by_material: dict[object, float] = {}
    for verdict in verdicts:
        number = asset.primitive(verdict.piece).get("material")
        by_material[number] = by_material.get(number, 0.0) + verdict.area * verdict.weathers
    largest = max(by_material.values())
    spared = any(verdict.kind == "glass" or verdict.reason == BY_MASK for verdict in verdicts)
    if largest > _PAINTED * weathered and largest > 0.5 and not spared:
        found.append(
            f"{largest:.0%} of {asset.path.name} is one material and no part is glass: if windows or lamps are painted "
            "on, they weather, too; --mask FILE.png, black over them, spares them, and --keep PATTERN whole parts."
        )
    kept = max((verdict for verdict in verdicts if not verdict.weathers), key=lambda each: each.area, default=None)
    if kept is not None and kept.kind != "ground" and kept.area > max(v.area for v in verdicts if v.weathers):
        found.append(
            f"the largest part, '{kept.name}', is kept ({kept.kind}: {kept.reason}); "
            "--learnable PATTERN lets it weather."
        )
    return found


def _verdict(asset: Asset, piece: int, judged: tuple[Facts, Judgement] | None, share: float) -> Verdict:
    if judged is None:
        return Verdict(piece, asset.pieces[piece].part.name, False, "body", "without faces", 0.0, True)
    facts, judgement = judged
    name = " / ".join(facts.names)
    return Verdict(piece, name, judgement.weathers, judgement.kind, judgement.reason, share, judgement.sure)


def _masked(judgement: Judgement, weathers: bool | None) -> Judgement:
    """The judgement after the user's masks, which say whether the piece weathers, or None. --keep wins over them."""
    if weathers is None or judgement.kind == _KEPT:
        return judgement
    return replace(judgement, weathers=weathers, reason=BY_MASK, sure=True)


def _asked(asset: Asset, facts: Facts, learnable: Sequence[str], keep: Sequence[str]) -> Judgement | None:
    """What the user's patterns say of a part."""
    names = {*facts.names, *asset.node_names(facts.pieces[0]), asset.pieces[facts.pieces[0]].part.name}
    pattern = _match(names, keep)
    if pattern is not None:
        return Judgement(_KEPT, False, f"--keep '{pattern}'")
    pattern = _match(names, learnable)
    return None if pattern is None else Judgement("learnable", True, f"--learnable '{pattern}'")


def _match(names: Iterable[str], patterns: Sequence[str]) -> str | None:
    lower = [name.lower() for name in names]
    return next((pattern for pattern in patterns if any(fnmatchcase(name, pattern.lower()) for name in lower)), None)


def _shares(asset: Asset) -> list[float]:
    area = face_areas(asset.mesh.positions, asset.mesh.faces)
    total = max(float(area.sum()), 1e-300)
    return [float(area[asset.faces(piece)].sum()) / total for piece in range(len(asset.pieces))]
