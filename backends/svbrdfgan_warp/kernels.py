"""Warp kernels: what camera samples meet, and the light there, as records.

A record is a camera sample's part (-1 where it met nothing), uv and weight, and two arrivals of light where gradients
want them. Record `i` of a chunk of neighbouring pixels is sample `i % spp` of pixel `first + i / spp`.
"""

# mypy: ignore-errors

import warp as wp

from svbrdfgan_warp import emitter, rng, traverse

wp.set_module_options({"enable_backward": False})


@wp.struct
class Geometry:
    nodes: wp.array(dtype=wp.uint32)  # of the tree, 20 words each
    triangles: wp.array2d(dtype=wp.vec4)  # in the tree's order
    radius: wp.float32  # of a sphere about the origin that holds all points
    points: wp.array(dtype=wp.vec3)
    corners: wp.array(dtype=wp.int32)
    normals: wp.array(dtype=wp.vec3)
    uv: wp.array(dtype=wp.vec2)
    face_part: wp.array(dtype=wp.int32)


@wp.struct
class Lens:
    origin: wp.vec3
    right: wp.vec3
    top: wp.vec3
    forward: wp.vec3
    width: wp.int32
    height: wp.int32


@wp.struct
class Samples:
    first: wp.int32  # pixel
    spp: wp.int32
    seed_low: wp.uint32
    seed_high: wp.uint32


@wp.struct
class Point:
    p: wp.vec3
    n: wp.vec3  # shading normal, on the viewer's side
    away: wp.vec3  # geometric normal, as long as rays must start away from the surface


@wp.func
def met(geometry: Geometry, corners: wp.vec3i, inside: wp.vec3, d: wp.vec3):
    """The point with the barycentrics `inside` of a face, met by a ray along `d`."""
    a = geometry.points[corners[0]]
    b = geometry.points[corners[1]]
    c = geometry.points[corners[2]]
    normal = wp.normalize(wp.cross(b - a, c - a))
    n = geometry.normals[corners[0]] * inside[0] + geometry.normals[corners[1]] * inside[1]
    n = wp.normalize(n + geometry.normals[corners[2]] * inside[2])
    if wp.dot(n, n) < 0.5:  # corner normals that cancel
        n = normal
    # The corners' size bounds the rounding error of the point between them.
    reach = wp.max(wp.max(wp.max(wp.abs(a)), wp.max(wp.abs(b))), wp.max(wp.abs(c)))
    point = Point()
    point.p = a * inside[0] + b * inside[1] + c * inside[2]
    point.n = n * wp.where(wp.dot(n, d) > 0.0, -1.0, 1.0)
    point.away = normal * (reach * 1.0e-5)
    return point


@wp.func
def share(geometry: Geometry, light: emitter.Light, point: Point, at: wp.vec2, d: wp.vec3):
    """What the radiance from the direction `d`, which leads to the place `at`, counts in the irradiance at a point.

    That is cosine over the summed densities of both techniques (balance heuristic), and zero under the horizon and in
    shadow.
    """
    cosine = wp.dot(point.n, d)
    if cosine <= 0.0:
        return 0.0
    start = point.p + point.away * wp.where(wp.dot(point.away, d) >= 0.0, 1.0, -1.0)
    if traverse.blocked(geometry.nodes, geometry.triangles, start, d):
        return 0.0
    return cosine / (emitter.density(light, at, d) + cosine / wp.pi)


@wp.func
def camera_ray(lens: Lens, pixel: int, a: float, b: float):
    """The direction through a place in a pixel, from its upper left corner."""
    x = (float(pixel % lens.width) + a) / float(lens.width) * 2.0 - 1.0
    y = 1.0 - (float(pixel / lens.width) + b) / float(lens.height) * 2.0
    return wp.normalize(lens.forward + lens.right * x + lens.top * y)


@wp.kernel
def find(
    geometry: Geometry,
    lens: Lens,
    samples: Samples,
    part: wp.array(dtype=wp.int32),
    uv: wp.array(dtype=wp.vec2),
):
    """What each camera sample meets: for the time being, its face in `part`, and in `uv` two of its barycentrics."""
    i = wp.tid()
    pixel = samples.first + i / samples.spp
    u, _ = rng.numbers(pixel, i % samples.spp, samples.seed_low, samples.seed_high)
    d = camera_ray(lens, pixel, rng.unit(u[0]), rng.unit(u[1]))
    # From the sphere on, not from a camera that may be far away: distances round off less.
    start = lens.origin + d * wp.max(0.0, -wp.dot(lens.origin, d) - geometry.radius)
    hit = traverse.nearest(geometry.nodes, geometry.triangles, start, d)
    part[i] = hit[0]
    uv[i] = wp.vec2(wp.cast(hit[1], wp.float32), wp.cast(hit[2], wp.float32))


@wp.kernel(cuda_max_registers=64)  # on an H200 3.4 ms instead of 4.3, since more threads hide each other's waiting
def light_up(
    geometry: Geometry,
    lens: Lens,
    light: emitter.Light,
    samples: Samples,
    part: wp.array(dtype=wp.int32),
    uv: wp.array(dtype=wp.vec2),
    weight: wp.array(dtype=wp.vec3),
    arrivals: wp.array2d(dtype=wp.vec3),
):
    """The records of the samples that `find` left: part, uv, and irradiance / pi / spp.

    The irradiance is estimated from two directions, drawn by light and by cosine. `arrivals`, unless it is empty,
    takes for each the place in the environment, and the share that its radiance has in the weight. Where the
    environment is black, a direction is worth a ray only for that share.
    """
    i = wp.tid()
    face = part[i]
    if face < 0:
        return
    corners = wp.vec3i(geometry.corners[face * 3], geometry.corners[face * 3 + 1], geometry.corners[face * 3 + 2])
    inside = wp.vec3(uv[i][0], uv[i][1], 1.0 - uv[i][0] - uv[i][1])
    part[i] = geometry.face_part[face]
    where = geometry.uv[corners[0]] * inside[0] + geometry.uv[corners[1]] * inside[1]
    uv[i] = where + geometry.uv[corners[2]] * inside[2]

    pixel = samples.first + i / samples.spp
    u, v = rng.numbers(pixel, i % samples.spp, samples.seed_low, samples.seed_high)
    point = met(geometry, corners, inside, camera_ray(lens, pixel, rng.unit(u[0]), rng.unit(u[1])))
    scale = 1.0 / (wp.pi * float(samples.spp))
    keep = arrivals.shape[0] > 0
    total = wp.vec3(0.0)
    technique = int(0)  # noqa: UP018, RUF046 - Warp's way to declare a variable
    while technique < 2:  # one loop, so that the traversal is in the kernel's code once
        if technique == 0:
            at = emitter.sampled(light, u[2], u[3], v[2], v[3])
            d = emitter.direction(light, at)
        else:
            d = rng.cosine_direction(point.n, rng.unit(v[0]), rng.unit(v[1]))
            at = emitter.place(light, d)
        radiance = emitter.radiance(light, at)
        counts = float(0.0)  # noqa: UP018
        if keep or wp.max(radiance) > 0.0:
            counts = share(geometry, light, point, at, d) * scale
        total += radiance * counts
        if keep:
            arrivals[i, technique] = wp.vec3(at[0], at[1], counts)
        technique += 1
    weight[i] = total
