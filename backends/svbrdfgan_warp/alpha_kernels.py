"""Warp kernels that trace rays through parts with alpha; scenes whose parts are all opaque never load them.

Whether a camera ray passes a face is drawn in the tree's traversal, by a hash of ray and face: so it does not depend on
the order in which faces are met. A ray to the light takes the product of 1 - alpha instead, which has less noise.
"""

# mypy: ignore-errors

from importlib import resources

import warp as wp

from svbrdfgan_warp import emitter, rng
from svbrdfgan_warp.bvh_kernels import TRAVERSE
from svbrdfgan_warp.frame import corners_of
from svbrdfgan_warp.material_kernels import Records, sample_ray, shadow_start
from svbrdfgan_warp.trace_kernels import Geometry, PreparedCamera, SampleRange, camera_start

wp.set_module_options({"enable_backward": False})

_ALPHA = resources.files(__package__).joinpath("native").joinpath("alpha.h").read_text(encoding="utf-8")


@wp.struct
class AlphaMaps:
    layout: wp.array(dtype=wp.vec3i)  # per part: first texel, rows, cols
    texels: wp.array(dtype=wp.float32)
    repeat_u: wp.bool
    repeat_v: wp.bool
    corners: wp.array(dtype=wp.int32)
    uv: wp.array(dtype=wp.vec2)
    face_part: wp.array(dtype=wp.int32)


# The mixing is MurmurHash3's finalizer, once for the face and once more for the second word of the ray.
_DRAW = """
unsigned int bits = first + (unsigned int)id.i * 0x9E3779B9u;
for (int round = 0; round < 2; ++round) {
    bits ^= bits >> 16; bits *= 0x85EBCA6Bu; bits ^= bits >> 13; bits *= 0xC2B2AE35u; bits ^= bits >> 16;
    bits += round == 0 ? second : 0u;
}
if ((float)(bits >> 8) * (1.0f / 16777216.0f) >= opacity)
    continue;
nearest = t; found.f = face; found_u = u / determinant; found_v = v / determinant;
"""


def _traversal(on_hit: str, result: str) -> str:
    """The traversal with these lines in it; its comment, which names both places, keeps the names."""
    return TRAVERSE.replace("        ON_HIT\n", on_hit).replace("\nRESULT\n", f"\n{result}\n")


@wp.func_native(
    _traversal(_ALPHA + _DRAW, "Word x, y; x.f = found_u; y.f = found_v; return wp::vec3i(found.i, x.i, y.i);")
)
def nearest_through(
    nodes: wp.array(dtype=wp.uint32),
    triangles: wp.array2d(dtype=wp.vec4),
    alpha: AlphaMaps,
    start: wp.vec3,
    d: wp.vec3,
    first: wp.uint32,
    second: wp.uint32,
) -> wp.vec3i:
    """The first face that a ray does not pass, as `bvh_kernels.nearest` has it; `first` and `second` are random."""


@wp.func_native(
    "float passed = 1.0f;\n"
    + _traversal(_ALPHA + "passed *= 1.0f - opacity;\nif (passed <= 0.0f)\n    return 0.0f;\n", "return passed;")
)
def transmittance(
    nodes: wp.array(dtype=wp.uint32),
    triangles: wp.array2d(dtype=wp.vec4),
    alpha: AlphaMaps,
    start: wp.vec3,
    d: wp.vec3,
) -> float:
    """The product of 1 - alpha of all that a ray meets."""


@wp.kernel
def find_hits_through(
    geometry: Geometry,
    alpha: AlphaMaps,
    camera: PreparedCamera,
    samples: SampleRange,
    face: wp.array(dtype=wp.int32),
    at: wp.array(dtype=wp.vec2),
):
    """Stores the hit of each camera sample, as `trace_kernels.find_hits` does."""
    i = wp.tid()
    pixel = samples.first + i / samples.spp
    d = sample_ray(camera, samples, i)
    # Streams 0 and 1 belong to `rng.numbers`.
    key = rng.hashed(wp.uint32(pixel), samples.seed_low, samples.seed_high, wp.uint32(i % samples.spp + 2))
    start = camera_start(geometry, camera, d)
    hit = nearest_through(geometry.nodes, geometry.triangles, alpha, start, d, key[0], key[1])
    face[i] = hit[0]
    at[i] = wp.vec2(wp.cast(hit[1], wp.float32), wp.cast(hit[2], wp.float32))


@wp.kernel(cuda_max_registers=64)
def trace_shadows_through(
    geometry: Geometry, alpha: AlphaMaps, environment: emitter.EnvironmentEmitter, records: Records
):
    """Multiplies the factors of light samples by what passes; otherwise as `material_kernels.trace_shadows`."""
    thread = wp.tid()
    technique = thread / records.face.shape[0]
    i = thread % records.face.shape[0]
    face = records.face[i]
    if face < 0:
        return
    light = records.light[i, technique]
    if light[2] == 0.0:
        return
    d = emitter.direction(environment, wp.vec2(light[0], light[1]))
    start = shadow_start(geometry, corners_of(geometry, face), records.at[i], d)
    passed = transmittance(geometry.nodes, geometry.triangles, alpha, start, d)
    records.light[i, technique] = wp.vec3(light[0], light[1], light[2] * passed)
