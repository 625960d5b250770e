"""Warp kernels for whole materials: light samples drawn and traced, the arithmetic of shading, and its derivatives.

A record is a camera sample's hit (its face, -1 for a miss, and two barycentrics) and two light samples. A light sample
is the position (x, y) of a direction in the environment, and the factor of `value * radiance` in the pixel: visibility
over the summed densities of both techniques (balance heuristic) and spp. Records hold nothing of the maps, nor of the
radiance: the maps only decided where directions were drawn, which gradients treat as constant.

Record `i` of a film chunk belongs to sample `i % spp` of pixel `first + i / spp`. Each kernel that computes has a
thread for each record; sums are left to `average` and to the transposes of lookups.
"""

# mypy: ignore-errors

from typing import Any

import warp as wp

from svbrdfgan_warp import bsdf, bvh_kernels, emitter, rng, texture_kernels
from svbrdfgan_warp.frame import Frame, TangentSpace, bent_normal, bent_normal_vjp, corners_of, frame_at, texture_uv
from svbrdfgan_warp.texture_kernels import RECORDS_PER_THREAD, Atlas
from svbrdfgan_warp.trace_kernels import Geometry, PreparedCamera, SampleRange, camera_ray, surface_point

wp.set_module_options({"enable_backward": False})


@wp.struct
class Maps:
    """All maps of all parts. A map that a part lacks is one neutral texel, number 0."""

    base_color_atlas: Atlas
    roughness_atlas: Atlas
    metallic_atlas: Atlas
    normal_atlas: Atlas
    base_color: wp.array(dtype=wp.vec3)
    roughness: wp.array(dtype=wp.float32)
    metallic: wp.array(dtype=wp.float32)
    normal: wp.array(dtype=wp.vec3)
    glossy: wp.array(dtype=wp.int32)  # per part, whether it has roughness
    tilted: wp.array(dtype=wp.int32)  # per part, whether it has a normal map


@wp.struct
class Records:
    samples: SampleRange
    face: wp.array(dtype=wp.int32)
    at: wp.array(dtype=wp.vec2)  # barycentrics of the face's first two corners
    light: wp.array2d(dtype=wp.vec3)  # (records, 2)


@wp.struct
class RecordGradients:
    """The gradient for each map at each record's lookup, and for each light sample's radiance; empty if unwanted."""

    base_color: wp.array(dtype=wp.vec3)
    roughness: wp.array(dtype=wp.float32)
    metallic: wp.array(dtype=wp.float32)
    normal: wp.array(dtype=wp.vec3)
    radiance: wp.array2d(dtype=wp.vec3)  # (records, 2)


@wp.func
def sample_ray(camera: PreparedCamera, samples: SampleRange, i: int):
    """The direction of a camera sample."""
    pixel = samples.first + i / samples.spp
    u, _ = rng.numbers(pixel, i % samples.spp, samples.seed_low, samples.seed_high)
    return camera_ray(camera, pixel, rng.unit(u[0]), rng.unit(u[1]))


@wp.func
def material_at(maps: Maps, frame: Frame):
    """The material at a hit, without its base colour, which must not decide where light is drawn."""
    material = bsdf.SurfaceMaterial()
    material.normal = frame.normal
    if maps.tilted[frame.part] != 0:
        mapped = texture_kernels.lookup(maps.normal_atlas, maps.normal, frame.part, frame.uv)
        material.normal = bent_normal(frame, mapped)
    if maps.glossy[frame.part] != 0:
        roughness = texture_kernels.lookup(maps.roughness_atlas, maps.roughness, frame.part, frame.uv)
        metallic = texture_kernels.lookup(maps.metallic_atlas, maps.metallic, frame.part, frame.uv)
        material.alpha2 = bsdf.alpha2_of(roughness)
        material.metallic = wp.clamp(metallic, 0.0, 1.0)
    return material


@wp.kernel
def draw_light(
    geometry: Geometry,
    space: TangentSpace,
    camera: PreparedCamera,
    environment: emitter.EnvironmentEmitter,
    maps: Maps,
    dark: wp.bool,
    records: Records,
):
    """Draws the light samples of the records, from the emitter and from the BSDF, as if nothing cast shadows.

    Factors are zero where no light counts, and in a black direction, too, unless `dark`.
    """
    i = wp.tid()
    if records.face[i] < 0:
        return
    samples = records.samples
    pixel = samples.first + i / samples.spp
    u, v = rng.numbers(pixel, i % samples.spp, samples.seed_low, samples.seed_high)
    ray = camera_ray(camera, pixel, rng.unit(u[0]), rng.unit(u[1]))
    frame = frame_at(geometry, space, records.face[i], records.at[i], ray)
    material = material_at(maps, frame)
    technique = int(0)  # noqa: UP018, RUF046 - Warp's way to declare a variable
    while technique < 2:  # a loop, so that the compiler inlines the densities once
        if technique == 0:
            at = emitter.sample(environment, u[2], u[3])
        else:
            drawn = bsdf.sample(material, frame.outgoing, rng.unit(v[0]), rng.unit(v[1]))
            at = emitter.position(environment, drawn)
        d = emitter.direction(environment, at)  # as `shade` will see it, so that it fits the density
        factor = float(0.0)  # noqa: UP018
        if wp.dot(material.normal, d) > 0.0 and wp.dot(frame.normal, d) > 0.0:  # noqa: SIM102 - no radiance if not
            if dark or wp.max(emitter.radiance(environment, at)) > 0.0:
                both = emitter.density(environment, at, d) + bsdf.density(material, frame.outgoing, d)
                factor = 1.0 / (both * float(samples.spp))
        records.light[i, technique] = wp.vec3(at[0], at[1], factor)
        technique += 1


@wp.func
def shadow_start(geometry: Geometry, corners: wp.vec3i, at: wp.vec2, d: wp.vec3):
    """The point, a little off the surface, where a ray along `d` starts."""
    point = surface_point(geometry, corners, wp.vec3(at[0], at[1], 1.0 - at[0] - at[1]), d)
    return point.p + point.offset * wp.where(wp.dot(point.offset, d) >= 0.0, 1.0, -1.0)


@wp.kernel(cuda_max_registers=64)  # as in `trace_kernels.illuminate_hits`
def trace_shadows(geometry: Geometry, environment: emitter.EnvironmentEmitter, records: Records):
    """Makes the factors of light samples in shadow zero: first of all samples of the emitter, then of the BSDF."""
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
    if bvh_kernels.blocked(geometry.nodes, geometry.triangles, start, d):
        records.light[i, technique] = wp.vec3(light[0], light[1], 0.0)


@wp.kernel
def shade(
    geometry: Geometry,
    space: TangentSpace,
    camera: PreparedCamera,
    environment: emitter.EnvironmentEmitter,
    maps: Maps,
    records: Records,
    radiance: wp.array(dtype=wp.vec3),
):
    """Stores the radiance that each record adds to its pixel."""
    i = wp.tid()
    total = wp.vec3(0.0)
    if records.face[i] >= 0:
        ray = sample_ray(camera, records.samples, i)
        frame = frame_at(geometry, space, records.face[i], records.at[i], ray)
        material = material_at(maps, frame)
        material.base_color = texture_kernels.lookup(maps.base_color_atlas, maps.base_color, frame.part, frame.uv)
        technique = int(0)  # noqa: UP018, RUF046
        while technique < 2:
            light = records.light[i, technique]
            if light[2] > 0.0:
                at = wp.vec2(light[0], light[1])
                value = bsdf.value(material, frame.outgoing, emitter.direction(environment, at))
                total += wp.cw_mul(value, emitter.radiance(environment, at)) * light[2]
            technique += 1
    radiance[i] = total


@wp.kernel
def weigh(
    geometry: Geometry,
    space: TangentSpace,
    camera: PreparedCamera,
    environment: emitter.EnvironmentEmitter,
    records: Records,
    part: wp.array(dtype=wp.int32),
    uv: wp.array(dtype=wp.vec2),
    weight: wp.array(dtype=wp.vec3),
):
    """Part, uv, and irradiance / pi / spp of each record, as `trace_kernels.illuminate_hits` has them."""
    i = wp.tid()
    part[i] = -1
    if records.face[i] < 0:
        return
    ray = sample_ray(camera, records.samples, i)
    frame = frame_at(geometry, space, records.face[i], records.at[i], ray)
    total = wp.vec3(0.0)
    for j in range(2):
        light = records.light[i, j]
        if light[2] > 0.0:
            at = wp.vec2(light[0], light[1])
            cosine = wp.dot(frame.normal, emitter.direction(environment, at))
            total += emitter.radiance(environment, at) * (light[2] * cosine / wp.pi)
    part[i] = frame.part
    uv[i] = frame.uv
    weight[i] = total


@wp.kernel
def average(
    samples: SampleRange,
    face: wp.array(dtype=wp.int32),
    radiance: wp.array(dtype=wp.vec3),
    image: wp.array(dtype=wp.vec3),
    coverage: wp.array(dtype=wp.float32),
):
    """The pixels of a film chunk: the sums over their records, and coverage."""
    pixel = wp.tid()
    total = wp.vec3(0.0)
    hits = int(0)  # noqa: UP018, RUF046
    for sample in range(samples.spp):
        i = pixel * samples.spp + sample
        total += radiance[i]
        if face[i] >= 0:
            hits += 1
    image[samples.first + pixel] = total
    coverage[samples.first + pixel] = float(hits) / float(samples.spp)


@wp.kernel
def shade_vjp(
    geometry: Geometry,
    space: TangentSpace,
    camera: PreparedCamera,
    environment: emitter.EnvironmentEmitter,
    maps: Maps,
    records: Records,
    grad_image: wp.array(dtype=wp.vec3),
    gradients: RecordGradients,
):
    """The gradient of sum(image * grad_image) for what each record looks up in the maps, and for its radiance."""
    i = wp.tid()
    if records.face[i] < 0:
        return
    samples = records.samples
    frame = frame_at(geometry, space, records.face[i], records.at[i], sample_ray(camera, samples, i))
    material = material_at(maps, frame)
    material.base_color = texture_kernels.lookup(maps.base_color_atlas, maps.base_color, frame.part, frame.uv)
    grad = grad_image[samples.first + i / samples.spp]
    total = bsdf.MaterialGradient()
    technique = int(0)  # noqa: UP018, RUF046
    while technique < 2:
        light = records.light[i, technique]
        through = wp.vec3(0.0)
        if light[2] > 0.0:
            at = wp.vec2(light[0], light[1])
            d = emitter.direction(environment, at)
            weight = wp.cw_mul(grad, emitter.radiance(environment, at)) * light[2]
            one = bsdf.value_vjp(material, frame.outgoing, d, weight)
            total.normal += one.normal
            total.base_color += one.base_color
            total.metallic += one.metallic
            total.alpha2 += one.alpha2
            if gradients.radiance.shape[0] > 0:
                through = wp.cw_mul(grad, bsdf.value(material, frame.outgoing, d)) * light[2]
        if gradients.radiance.shape[0] > 0:
            gradients.radiance[i, technique] = through
        technique += 1
    if gradients.base_color.shape[0] > 0:
        gradients.base_color[i] = total.base_color
    if gradients.roughness.shape[0] > 0:
        roughness = texture_kernels.lookup(maps.roughness_atlas, maps.roughness, frame.part, frame.uv)
        gradients.roughness[i] = total.alpha2 * bsdf.alpha2_slope(roughness)
    if gradients.metallic.shape[0] > 0:
        metallic = texture_kernels.lookup(maps.metallic_atlas, maps.metallic, frame.part, frame.uv)
        gradients.metallic[i] = wp.where(metallic >= 0.0 and metallic <= 1.0, total.metallic, 0.0)
    if gradients.normal.shape[0] > 0:
        passed = wp.vec3(0.0)
        if maps.tilted[frame.part] != 0:
            mapped = texture_kernels.lookup(maps.normal_atlas, maps.normal, frame.part, frame.uv)
            passed = bent_normal_vjp(frame, mapped, total.normal)
        gradients.normal[i] = passed


@wp.kernel
def scatter_map(
    geometry: Geometry, atlas: Atlas, records: Records, gradient: wp.array(dtype=Any), sums: wp.array(dtype=Any)
):
    """The transpose of `lookup`: adds each record's gradient to the texels of one map.

    Each thread takes consecutive records and adds each run of equal texels at once, as `scatter_texels` does.
    """
    first = wp.tid() * RECORDS_PER_THREAD
    texel = wp.vec4i(-1, -1, -1, -1)
    a = gradient.dtype(0.0)
    b = gradient.dtype(0.0)
    c = gradient.dtype(0.0)
    d = gradient.dtype(0.0)
    for i in range(first, wp.min(first + RECORDS_PER_THREAD, records.face.shape[0])):
        face = records.face[i]
        if face >= 0:
            uv = texture_uv(geometry, corners_of(geometry, face), records.at[i])
            t, w = texture_kernels.taps(atlas, geometry.face_part[face], uv)
            if t[0] != texel[0] or t[3] != texel[3]:
                texture_kernels.add_to_texels(sums, texel, a, b, c, d)
                texel = t
                a = gradient.dtype(0.0)
                b = gradient.dtype(0.0)
                c = gradient.dtype(0.0)
                d = gradient.dtype(0.0)
            g = gradient[i]
            a += g * w[0]
            b += g * w[1]
            c += g * w[2]
            d += g * w[3]
    texture_kernels.add_to_texels(sums, texel, a, b, c, d)


scatter_colors = wp.overload(scatter_map, {"gradient": wp.array(dtype=wp.vec3), "sums": wp.array(dtype=wp.vec3d)})
scatter_numbers = wp.overload(scatter_map, {"gradient": wp.array(dtype=wp.float32), "sums": wp.array(dtype=wp.float64)})


@wp.kernel
def scatter_light(records: Records, gradient: wp.array2d(dtype=wp.vec3), grad_radiance: wp.array2d(dtype=wp.vec3d)):
    """The transpose of the environment's lookup: adds each light sample's gradient to the pixels around it."""
    i = wp.tid()
    if records.face[i] >= 0:
        for j in range(2):
            light = records.light[i, j]
            if light[2] > 0.0:
                at = wp.vec2(light[0], light[1])
                row, col, w = emitter.taps(grad_radiance.shape[0], grad_radiance.shape[1], at)
                for k in range(4):
                    wp.atomic_add(grad_radiance, row[k], col[k], wp.vec3d(gradient[i, j] * w[k]))
