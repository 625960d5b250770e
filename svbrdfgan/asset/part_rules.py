"""The rules by which a part is judged: what it is, whether it weathers, and why, from its facts."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from svbrdfgan.asset.part_facts import Facts
from svbrdfgan.asset.part_words import WEATHERED, Shades, Telling, telling

_MOST = {"glass": 0.6, "tyre": 0.6, "rim": 0.4, "wheel": 0.6, "chrome": 0.4, "lamp": 0.25, "mirror": 0.2, "plate": 0.1}
_MOST |= {"interior": 0.6, "ground": 0.0, "decal": 0.3, "rubber": 0.4}
"""The largest shares of the whole at which a name is believed."""
_MOST_WEAK = 0.04  # likewise, for words that often mean something else
_OPAQUE = 0.99
_GLOWS = 0.05
_IN_WHEEL = 0.6  # share of its area that makes a part one of wheels
_HIDDEN = 0.08  # visibility below which a part is seen from nowhere


@dataclass(frozen=True)
class Judgement:
    """What a part is, and why; it is sure unless it rests on looks or on doubtful names."""

    kind: str
    weathers: bool
    reason: str
    sure: bool = True


@dataclass(frozen=True)
class Context:
    """What rules need to know of the other parts.

    Attributes:
        shades: of all names of the file.
        wheels: whether wheels were found by their shape.
    """

    shades: Shades
    wheels: bool


Rule = Callable[[Facts, Context], Judgement | None]


def judge_part(facts: Facts, context: Context) -> Judgement:
    """What the first rule that knows the part says of it; if none does, it weathers."""
    looks: Sequence[Rule] = (_by_emission, _by_sheen, _by_gloss, _by_hiding)
    rules = (_by_place, _by_transparency, _by_names, _by_wheels, *looks)
    found = next((judged for rule in rules if (judged := rule(facts, context)) is not None), None)
    return found or _weathered(facts, context)


def _by_place(facts: Facts, context: Context) -> Judgement | None:
    return Judgement("ground", False, "a flat sheet under all else") if facts.ground else None


def _by_transparency(facts: Facts, context: Context) -> Judgement | None:
    looks, said = facts.looks, _said(facts, context)
    kind = said.kind if said is not None and said.kind in ("lamp", "decal", "ground", "mirror") else "glass"
    if looks.transmission > 0.05:
        return Judgement(kind, False, f"light passes through it (transmission {looks.transmission:.1f})")
    if looks.blended and looks.alpha < _OPAQUE:
        return Judgement(kind, False, f"blended, mean alpha {looks.alpha:.2f}")
    return None


def _by_names(facts: Facts, context: Context) -> Judgement | None:
    said = _said(facts, context)
    if said is None or said.kind in WEATHERED:
        return None
    if said.kind in ("tyre", "rubber", "wheel", "rim"):
        return _wheel_by_name(facts, context, said)
    most = _MOST_WEAK if said.weak else _MOST[said.kind]
    if facts.share > most:
        return None
    return Judgement(said.kind, False, f"called '{said.word}'", sure=not said.weak)


def _wheel_by_name(facts: Facts, context: Context, said: Telling) -> Judgement | None:
    """Rubber beside found wheels seals something, and a wheel far above the ground steers."""
    stands = facts.low[1] < 0.1
    if facts.share > _MOST[said.kind] and facts.wheel < _IN_WHEEL:
        return None
    if said.weak and facts.wheel < 0.3:
        return None
    if said.kind == "wheel" and not stands and facts.wheel == 0.0 and facts.share < 0.02 and facts.low[1] > 0.3:
        return Judgement("interior", False, "a wheel that is far from the ground", sure=False)
    kind = "tyre" if said.kind == "rubber" and (facts.wheel > 0.3 or not context.wheels) else said.kind
    return Judgement(kind, False, f"called '{said.word}'")


def _by_wheels(facts: Facts, context: Context) -> Judgement | None:
    if facts.wheel < _IN_WHEEL:
        return None
    looks, tread, positive = facts.looks, facts.tread > 0.5 * facts.wheel, _positive(facts, context)
    if not tread and positive is not None:  # such as an axle between the wheels
        return None
    rubber = looks.luminance < 0.1 and (looks.metallic or 0.0) < 0.5 and (looks.roughness or 1.0) > 0.3
    if tread and rubber:
        return Judgement("tyre", False, "round, dark and on the ground")
    return Judgement("wheel" if tread else "rim", False, "round and on the ground" if tread else "inside the wheels")


def _by_emission(facts: Facts, context: Context) -> Judgement | None:
    named = _positive(facts, context) is not None and facts.share > _MOST_WEAK
    if named or facts.looks.emission < _GLOWS or facts.share > _MOST["lamp"]:
        return None
    return Judgement("lamp", False, "emits light")


def _by_sheen(facts: Facts, context: Context) -> Judgement | None:
    if not facts.looks.sheen or _positive(facts, context) is not None:
        return None
    return Judgement("interior", False, "cloth, by its sheen", sure=False)


def _by_gloss(facts: Facts, context: Context) -> Judgement | None:
    """Chrome is a small smooth grey metal; opaque glass is dark, smooth, plain, and above the belt."""
    looks = facts.looks
    if looks.roughness is None or looks.metallic is None or looks.roughness > 0.25 or looks.varied > 0.1:
        return None
    if _positive(facts, context) is not None:
        return None
    if looks.metallic > 0.9 and looks.saturation < 0.2 and looks.luminance > 0.3 and facts.share < 0.1:
        return Judgement("chrome", False, "a smooth, bright, grey metal", sure=False)
    above = facts.low[1] > 0.35 and facts.high[1] < 0.99 and facts.wheel == 0.0
    if above and looks.luminance < 0.06 and 0.005 < facts.share < 0.2:
        return Judgement("glass", False, "dark and smooth, above the belt line", sure=False)
    return None


def _by_hiding(facts: Facts, context: Context) -> Judgement | None:
    inside = (facts.low > 0.02).all() and (facts.high < 0.98).all()
    if facts.open < _HIDDEN and inside and facts.share < 0.4:
        return Judgement("interior", False, "enclosed by other parts", sure=False)
    return None


def _weathered(facts: Facts, context: Context) -> Judgement:
    said, positive = _said(facts, context), _positive(facts, context)
    if said is not None and positive is None:
        return Judgement("body", True, f"called '{said.word}', but too large or not at its place", sure=False)
    if positive is not None:
        return Judgement(positive.kind, True, f"called '{positive.word}'")
    return Judgement("body", True, "opaque, and nothing tells that it is kept")


def _said(facts: Facts, context: Context) -> Telling | None:
    """What the most telling name says: the material's, then the mesh's and the node's, then those above."""
    told = [found for name in (*facts.names, *facts.above) if (found := telling(name, context.shades)) is not None]
    return told[0] if told else None


def _positive(facts: Facts, context: Context) -> Telling | None:
    said = _said(facts, context)
    return said if said is not None and said.kind in WEATHERED else None
