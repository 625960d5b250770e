"""How much memory a benchmark takes: the scene in one process, and what a renderer makes of it in another."""

from __future__ import annotations

from collections.abc import Iterable

from svbrdfgan.bench.cases import Case
from svbrdfgan.utils.memory import PROGRAM, most_that_fits, require_memory

_PROGRAMS = 2 * PROGRAM + (130 << 20)  # bytes of both processes with the renderer's libraries
_VERTEX = 1500  # bytes of a vertex and its two faces while the scene is made, in float64
_TEXEL = 100  # bytes of a texel of the scene and, for each picture of a batch, of all maps and their gradients
_PIXEL = 300  # bytes of a pixel and picture of a batch: the picture, its gradient, and its stored light transport
_SAMPLE = 36  # bytes of a sample that is kept for a gradient
_KEPT = 2**22  # samples that are kept at most


def case_bytes(case: Case, texels: int) -> int:
    """What both processes hold at most: the sum of single processes, estimated; no whole benchmark was measured."""
    pixels = case.batch * case.pixels**2
    samples = min(case.batch * _KEPT, pixels * case.spp)
    surface, textures = _VERTEX * (case.vertices or 0), _TEXEL * (case.batch + 1) * texels**2
    return _PROGRAMS + surface + textures + _PIXEL * pixels + _SAMPLE * samples


def require_bench(cases: Iterable[Case], texels: int) -> int:
    """The bytes that the largest case takes, if they may be taken.

    Raises:
        ConfigError: more are needed than are allowed; it says how many vertices, pixels or texels would fit.
    """
    largest = max(cases, key=lambda case: case_bytes(case, texels))

    def fitting(allowed: int) -> str | None:
        options = {"vertices": largest.vertices or 0, "pixels": largest.pixels, "texels": texels}
        for name, value in options.items():

            def needed(number: int, name: str = name) -> int:
                vertices, pixels, side = (number if name == each else options[each] for each in options)
                case = Case(largest.scene, vertices, pixels, largest.spp, largest.batch)
                return case_bytes(case, side)

            if (fits := most_that_fits(needed, value, allowed)) is not None:
                return f"--{name} {fits}"
        return None

    vertices = f"{largest.vertices:,} vertices, " if largest.vertices else ""
    what = f"{vertices}{largest.pixels} x {largest.pixels} pixels and {texels} x {texels} texels"
    return require_memory(f"a scene of {what} needs", case_bytes(largest, texels), fitting)
