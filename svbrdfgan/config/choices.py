"""Keys that data sets, scenes and training have in common: plugins, parts of a mesh, further maps of a layer."""

from __future__ import annotations

from fnmatch import fnmatchcase
from typing import Annotated, Any, TypeVar

from pydantic import AfterValidator, BeforeValidator, Field

from svbrdfgan.config.models import StrictModel
from svbrdfgan.types import FURTHER_MAPS, Part

MOST_SAMPLES = 65_536
"""Samples per pixel of exemplars and fakes."""

T = TypeVar("T")


def _in_order(maps: dict[str, T]) -> dict[str, T]:
    """The maps in the order of a layer's channels."""
    for name in maps:
        if name not in FURTHER_MAPS:
            raise ValueError(
                f"{name!r} is not a map that layers have besides base_color; known: {', '.join(FURTHER_MAPS)}"
            )
    if "metallic" in maps and "roughness" not in maps:
        raise ValueError("metallic needs roughness: declare a value for both")
    if "normal" in maps and getattr(maps["normal"], "fixed", maps["normal"]) != 0:
        raise ValueError("normal is the relief under the layer, of which there is none so far; wanted 0")
    return {name: maps[name] for name in FURTHER_MAPS if name in maps}


FurtherMaps = Annotated[dict[str, T], AfterValidator(_in_order)]
"""A value for each of the maps that a layer has besides base_color. That of `normal` is 0: no relief."""


class PluginChoice(StrictModel):
    """A renderer or embedding by name, with its own options: `{name: warp, device: cpu}`, or `warp` for no options."""

    name: str = Field(description="the plugin's name")
    options: dict[str, Any] = Field(default={}, description="its options")


def _named(value: Any) -> Any:
    """Reads `warp` and `{name: warp, device: cpu}` as users write them, and `{name, options}` as files store them."""
    if isinstance(value, str):
        return {"name": value}
    if isinstance(value, dict) and "options" not in value:
        return {"name": value.get("name", ""), "options": {k: v for k, v in value.items() if k != "name"}}
    return value


PluginField = Annotated[PluginChoice, BeforeValidator(_named)]
"""The type of a key that names a renderer or embedding."""


class PartSelection(StrictModel):
    """The parts of a mesh that carry the layer (thesis 4.2: "learnable"): shell patterns, case ignored."""

    include: tuple[str, ...] = Field(default=("*",), description="patterns over part (material) names")
    exclude: tuple[str, ...] = Field(
        default=(
            *("*glass*", "*window*", "*windscreen*", "*wheel*", "*tire*", "*tyre*", "*rim*", "*rubber*"),
            *("*light*", "*lamp*", "*interior*", "*seat*", "*plate*", "*mirror*"),
        ),
        description="patterns that take parts out again",
    )

    def selects(self, part: Part) -> bool:
        """Whether the part is learnable. Hidden parts never are."""
        name = part.name.lower()
        wanted = any(fnmatchcase(name, pattern.lower()) for pattern in self.include)
        return wanted and not part.hidden and not any(fnmatchcase(name, p.lower()) for p in self.exclude)
