"""What both data sets and scenes name in their files: plugins, parts of a mesh, maps that layers paint."""

from __future__ import annotations

from fnmatch import fnmatchcase
from typing import Annotated, Any, TypeVar

from pydantic import AfterValidator, BeforeValidator

from svbrdfgan.config.models import StrictModel
from svbrdfgan.types import Part
from svbrdfgan.types.material import CHANNELS

FURTHER_MAPS = tuple(name for name, channels in CHANNELS.items() if channels == 1)
"""Maps that layers may paint beside base_color: those of one number in [0, 1]."""

T = TypeVar("T")


def _in_order(maps: dict[str, T]) -> dict[str, T]:
    """As ordered in `CHANNELS`, however written: that is how the channels of a layer lie."""
    for name in maps:
        if name not in FURTHER_MAPS:
            raise ValueError(
                f"{name!r} is not a map that is painted beside base_color; known: {', '.join(FURTHER_MAPS)}"
            )
    return {name: maps[name] for name in FURTHER_MAPS if name in maps}


FurtherMaps = Annotated[dict[str, T], AfterValidator(_in_order)]
"""Something for each of the maps that layers paint beside base_color."""


class PluginChoice(StrictModel):
    """A renderer or embedding by name, with its own options. `warp` is short for `{name: warp}`."""

    name: str
    options: dict[str, Any] = {}


def _named(value: Any) -> Any:
    """`warp` and `{name: warp, device: cpu}` as users write them; `{name, options}` as files keep them."""
    if isinstance(value, str):
        return {"name": value}
    if isinstance(value, dict) and "options" not in value:
        return {"name": value.get("name", ""), "options": {k: v for k, v in value.items() if k != "name"}}
    return value


Plugin = Annotated[PluginChoice, BeforeValidator(_named)]


class PartSelection(StrictModel):
    """Which parts of a mesh carry the layer (thesis 4.2: "learnable"): shell patterns over part names, case ignored."""

    include: tuple[str, ...] = ("*",)
    exclude: tuple[str, ...] = (
        *("*glass*", "*window*", "*windscreen*", "*wheel*", "*tire*", "*tyre*", "*rim*", "*rubber*"),
        *("*light*", "*lamp*", "*interior*", "*seat*", "*plate*", "*mirror*"),
    )

    def selects(self, part: Part) -> bool:
        """Whether the part is learnable. Hidden ones never are."""
        name = part.name.lower()
        wanted = any(fnmatchcase(name, pattern.lower()) for pattern in self.include)
        return wanted and not part.hidden and not any(fnmatchcase(name, p.lower()) for p in self.exclude)
