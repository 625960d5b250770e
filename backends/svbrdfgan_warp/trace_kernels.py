"""Warp kernels that trace camera samples: what they hit, and the light there, as records.

A record is a camera sample's part (-1 for a miss), uv and weight, and two light samples where gradients need them.
Record `i` of a film chunk belongs to sample `i % spp` of pixel `first + i / spp`.

Nothing here is differentiated by Warp. A picture is linear in the textures and, for given directions, in the radiance;
the records hold the coefficients, and `texture_kernels` applies them and their transpose.
"""

# mypy: ignore-errors

import warp as wp

from svbrdfgan_warp import bvh_kernels, emitter, rng

wp.set_module_options({"enable_backward": False})


@wp.struct
class Geometry:
    nodes: wp.array(dtype=wp.uint32)  # of the BVH, 20 words each
    triangles: wp.array2d(dtype=wp.vec4)  # in the BVH's order
    radius: wp.float32  # of a sphere about the origin that contains the surface
    points: wp.array(dtype=wp.vec3)
    corners: wp.array(dtype=wp.int32)
    normals: wp.array(dtype=wp.vec3)
    uv: wp.array(dtype=wp.vec2)
    face_part: wp.array(dtype=wp.int32)


@wp.struct
class PreparedCamera:
    origin: wp.vec3
    right: wp.vec3
    top: wp.vec3
    forward: wp.vec3
    width: wp.int32
    height: wp.int32


@wp.struct
class SampleRange:
    first: wp.int32  # first pixel
    spp: wp.int32
    seed_low: wp.uint32
    seed_high: wp.uint32


@wp.struct
class SurfacePoint:
    p: wp.vec3
    n: wp.vec3  # shading normal, turned to the viewer
    offset: wp.vec3  # along the geometric normal, as far as rays must start from the surface


@wp.func
def surface_point(geometry: Geometry, corners: wp.vec3i, barycentric: wp.vec3, d: wp.vec3):
    """The point of a face with these barycentrics, hit by a ray along `d`."""
    a = geometry.points[corners[0]]
    b = geometry.points[corners[1]]
    c = geometry.points[corners[2]]
    normal = wp.normalize(wp.cross(b - a, c - a))
    n = geometry.normals[corners[0]] * barycentric[0] + geometry.normals[corners[1]] * barycentric[1]
    n = wp.normalize(n + geometry.normals[corners[2]] * barycentric[2])
    if wp.dot(n, n) < 0.5:  # the corners' normals cancel
        n = normal
    # The largest coordinate bounds the float32 rounding error of the interpolated point, which `offset` must exceed.
    reach = wp.max(wp.max(wp.max(wp.abs(a)), wp.max(wp.abs(b))), wp.max(wp.abs(c)))
    point = SurfacePoint()
    point.p = a * barycentric[0] + b * barycentric[1] + c * barycentric[2]
    point.n = n * wp.where(wp.dot(n, d) > 0.0, -1.0, 1.0)
    point.offset = normal * (reach * 1.0e-5)
    return point


@wp.func
def irradiance_weight(
    geometry: Geometry, environment: emitter.EnvironmentEmitter, point: SurfacePoint, at: wp.vec2, d: wp.vec3
):
    """The weight, in the irradiance at a point, of the radiance from the direction `d` to the position `at`.

    The weight is the cosine over the summed densities of both techniques (balance heuristic), and zero below the
    horizon and in shadow.
    """
    cosine = wp.dot(point.n, d)
    if cosine <= 0.0:
        return 0.0
    start = point.p + point.offset * wp.where(wp.dot(point.offset, d) >= 0.0, 1.0, -1.0)
    if bvh_kernels.blocked(geometry.nodes, geometry.triangles, start, d):
        return 0.0
    return cosine / (emitter.density(environment, at, d) + cosine / wp.pi)


@wp.func
def record_of(samples: SampleRange, order: wp.array(dtype=wp.int32), thread: int):
    """The record that a thread makes, if the threads of a pixel take its samples in this order."""
    sample = thread % samples.spp
    return thread - sample + order[sample]


@wp.func
def camera_ray(camera: PreparedCamera, pixel: int, a: float, b: float):
    """The direction through a pixel, at (a, b) from its upper left corner."""
    x = (float(pixel % camera.width) + a) / float(camera.width) * 2.0 - 1.0
    y = 1.0 - (float(pixel / camera.width) + b) / float(camera.height) * 2.0
    return wp.normalize(camera.forward + camera.right * x + camera.top * y)


@wp.func
def camera_start(geometry: Geometry, camera: PreparedCamera, d: wp.vec3):
    """The start of a camera ray, at the bounding sphere: distances from a far camera would lose digits."""
    return camera.origin + d * wp.max(0.0, -wp.dot(camera.origin, d) - geometry.radius)


@wp.kernel
def find_hits(
    geometry: Geometry,
    camera: PreparedCamera,
    samples: SampleRange,
    part: wp.array(dtype=wp.int32),
    uv: wp.array(dtype=wp.vec2),
    order: wp.array(dtype=wp.int32),
):
    """The hit of each camera sample, for `illuminate_hits` to replace: its face in `part`, two barycentrics in `uv`.

    Threads take the samples of a pixel in `order`.
    """
    i = record_of(samples, order, wp.tid())
    pixel = samples.first + i / samples.spp
    u, _ = rng.numbers(pixel, i % samples.spp, samples.seed_low, samples.seed_high)
    d = camera_ray(camera, pixel, rng.unit(u[0]), rng.unit(u[1]))
    hit = bvh_kernels.nearest(geometry.nodes, geometry.triangles, camera_start(geometry, camera, d), d)
    part[i] = hit[0]
    uv[i] = wp.vec2(wp.cast(hit[1], wp.float32), wp.cast(hit[2], wp.float32))


@wp.kernel(cuda_max_registers=64)  # 3.4 instead of 4.3 ms on an H200: more resident threads hide memory latency
def illuminate_hits(
    geometry: Geometry,
    camera: PreparedCamera,
    environment: emitter.EnvironmentEmitter,
    samples: SampleRange,
    part: wp.array(dtype=wp.int32),
    uv: wp.array(dtype=wp.vec2),
    weight: wp.array(dtype=wp.vec3),
    light_samples: wp.array2d(dtype=wp.vec3),
    order: wp.array(dtype=wp.int32),
):
    """The records of the samples, from the hits of `find_hits`: part, uv, and irradiance / pi / spp.

    The irradiance is estimated from two directions, drawn by the emitter and by the cosine. `light_samples`, unless it
    is empty, receives for each direction its position in the environment and the factor of the radiance there. Where
    the environment is black, a shadow ray is traced only if that factor is wanted. Threads take the samples of a pixel
    in `order`.
    """
    i = record_of(samples, order, wp.tid())
    face = part[i]
    if face < 0:
        return
    corners = wp.vec3i(geometry.corners[face * 3], geometry.corners[face * 3 + 1], geometry.corners[face * 3 + 2])
    barycentric = wp.vec3(uv[i][0], uv[i][1], 1.0 - uv[i][0] - uv[i][1])
    part[i] = geometry.face_part[face]
    texture_uv = geometry.uv[corners[0]] * barycentric[0] + geometry.uv[corners[1]] * barycentric[1]
    uv[i] = texture_uv + geometry.uv[corners[2]] * barycentric[2]

    pixel = samples.first + i / samples.spp
    u, v = rng.numbers(pixel, i % samples.spp, samples.seed_low, samples.seed_high)
    point = surface_point(geometry, corners, barycentric, camera_ray(camera, pixel, rng.unit(u[0]), rng.unit(u[1])))
    scale = 1.0 / (wp.pi * float(samples.spp))
    keep = light_samples.shape[0] > 0
    total = wp.vec3(0.0)
    technique = int(0)  # noqa: UP018, RUF046 - Warp's way to declare a variable
    while technique < 2:  # a loop, so that the compiler inlines the traversal once
        if technique == 0:
            at = emitter.sample(environment, u[2], u[3])
            d = emitter.direction(environment, at)
        else:
            d = rng.cosine_direction(point.n, rng.unit(v[0]), rng.unit(v[1]))
            at = emitter.position(environment, d)
        radiance = emitter.radiance(environment, at)
        factor = float(0.0)  # noqa: UP018
        if keep or wp.max(radiance) > 0.0:
            factor = irradiance_weight(geometry, environment, point, at, d) * scale
        total += radiance * factor
        if keep:
            light_samples[i, technique] = wp.vec3(at[0], at[1], factor)
        technique += 1
    weight[i] = total
