"""Warp kernels: trace camera samples to records, look textures up through them, and the transpose of that.

A record is a camera sample's part (-1 where it met nothing), uv and weight, and two arrivals of light where gradients
want them. Record `i` of a chunk of neighbouring pixels is sample `i % spp` of pixel `first + i / spp`.

Gradients are summed in float64: in float32 a constant colour's stands still after 2^24 equal additions.
"""

# mypy: ignore-errors

import warp as wp

from svbrdfgan_warp import chance, emitter, traverse

wp.set_module_options({"enable_backward": False})

RUN = wp.constant(16)
"""Records whose gradients a thread adds up before it passes them on."""


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
class Atlas:
    layout: wp.array(dtype=wp.vec3i)  # per part: first texel, rows, cols
    repeat_u: wp.bool
    repeat_v: wp.bool


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
    u, _ = chance.numbers(pixel, i % samples.spp, samples.seed_low, samples.seed_high)
    d = camera_ray(lens, pixel, chance.unit(u[0]), chance.unit(u[1]))
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
    u, v = chance.numbers(pixel, i % samples.spp, samples.seed_low, samples.seed_high)
    point = met(geometry, corners, inside, camera_ray(lens, pixel, chance.unit(u[0]), chance.unit(u[1])))
    scale = 1.0 / (wp.pi * float(samples.spp))
    keep = arrivals.shape[0] > 0
    total = wp.vec3(0.0)
    technique = int(0)  # noqa: UP018, RUF046 - Warp's way to declare a variable
    while technique < 2:  # one loop, so that the traversal is in the kernel's code once
        if technique == 0:
            at = emitter.sampled(light, u[2], u[3], v[2], v[3])
            d = emitter.direction(light, at)
        else:
            d = chance.cosine_direction(point.n, chance.unit(v[0]), chance.unit(v[1]))
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


@wp.func
def placed(i: int, n: int, repeat: bool):
    if repeat:
        return ((i % n) + n) % n
    return wp.clamp(i, 0, n - 1)


@wp.func
def taps(atlas: Atlas, part: int, uv: wp.vec2):
    """The four texels around `uv` and their bilinear weights."""
    layout = atlas.layout[part]
    x = uv[0] * float(layout[2]) - 0.5
    y = uv[1] * float(layout[1]) - 0.5
    col = int(wp.floor(x))
    row = int(wp.floor(y))
    a = x - float(col)
    b = y - float(row)
    left = placed(col, layout[2], atlas.repeat_u)
    right = placed(col + 1, layout[2], atlas.repeat_u)
    below = layout[0] + placed(row, layout[1], atlas.repeat_v) * layout[2]
    above = layout[0] + placed(row + 1, layout[1], atlas.repeat_v) * layout[2]
    texels = wp.vec4i(below + left, below + right, above + left, above + right)
    return texels, wp.vec4((1.0 - a) * (1.0 - b), a * (1.0 - b), (1.0 - a) * b, a * b)


@wp.func
def albedo(atlas: Atlas, texels: wp.array(dtype=wp.vec3), part: int, uv: wp.vec2):
    t, w = taps(atlas, part, uv)
    return texels[t[0]] * w[0] + texels[t[1]] * w[1] + texels[t[2]] * w[2] + texels[t[3]] * w[3]


@wp.kernel
def gather(
    atlas: Atlas,
    samples: Samples,
    part: wp.array(dtype=wp.int32),
    uv: wp.array(dtype=wp.vec2),
    weight: wp.array(dtype=wp.vec3),
    texels: wp.array(dtype=wp.vec3),
    image: wp.array(dtype=wp.vec3),
    coverage: wp.array(dtype=wp.float32),
):
    """The chunk's pixels: the sum of weight * base_color over their records."""
    pixel = wp.tid()
    total = wp.vec3(0.0)
    met = int(0)  # noqa: UP018, RUF046
    for sample in range(samples.spp):
        i = pixel * samples.spp + sample
        if part[i] >= 0:
            total += wp.cw_mul(weight[i], albedo(atlas, texels, part[i], uv[i]))
            met += 1
    image[samples.first + pixel] = total
    coverage[samples.first + pixel] = float(met) / float(samples.spp)


@wp.func
def pour(grad_texels: wp.array(dtype=wp.vec3d), place: wp.vec4i, a: wp.vec3, b: wp.vec3, c: wp.vec3, d: wp.vec3):
    """Adds four sums to their texels; where all are one, once. Nothing is added at a place of -1."""
    if place[0] < 0:
        return
    if place[0] == place[3]:
        wp.atomic_add(grad_texels, place[0], wp.vec3d(a + b + c + d))
    else:
        wp.atomic_add(grad_texels, place[0], wp.vec3d(a))
        wp.atomic_add(grad_texels, place[1], wp.vec3d(b))
        wp.atomic_add(grad_texels, place[2], wp.vec3d(c))
        wp.atomic_add(grad_texels, place[3], wp.vec3d(d))


@wp.kernel
def scatter_texels(
    atlas: Atlas,
    samples: Samples,
    records: int,
    part: wp.array(dtype=wp.int32),
    uv: wp.array(dtype=wp.vec2),
    weight: wp.array(dtype=wp.vec3),
    grad_image: wp.array(dtype=wp.vec3),
    grad_texels: wp.array(dtype=wp.vec3d),
):
    """The transpose of `gather`: adds weight * grad_image to the texels of each record.

    A thread takes RUN records in a row and adds at once what is for the same texels: else all samples of a part of one
    colour would queue for one texel.
    """
    first = wp.tid() * RUN
    place = wp.vec4i(-1, -1, -1, -1)
    a = wp.vec3(0.0)
    b = wp.vec3(0.0)
    c = wp.vec3(0.0)
    d = wp.vec3(0.0)
    for i in range(first, wp.min(first + RUN, records)):
        if part[i] >= 0:
            t, w = taps(atlas, part[i], uv[i])
            if t[0] != place[0] or t[3] != place[3]:
                pour(grad_texels, place, a, b, c, d)
                place = t
                a = wp.vec3(0.0)
                b = wp.vec3(0.0)
                c = wp.vec3(0.0)
                d = wp.vec3(0.0)
            g = wp.cw_mul(weight[i], grad_image[samples.first + i / samples.spp])
            a += g * w[0]
            b += g * w[1]
            c += g * w[2]
            d += g * w[3]
    pour(grad_texels, place, a, b, c, d)


@wp.kernel
def scatter_light(
    atlas: Atlas,
    samples: Samples,
    part: wp.array(dtype=wp.int32),
    uv: wp.array(dtype=wp.vec2),
    arrivals: wp.array2d(dtype=wp.vec3),
    texels: wp.array(dtype=wp.vec3),
    grad_image: wp.array(dtype=wp.vec3),
    grad_light: wp.array2d(dtype=wp.vec3d),
):
    """The transpose of `trace` and `gather`: adds share * base_color * grad_image to the pixels of each arrival."""
    i = wp.tid()
    if part[i] >= 0:
        g = wp.cw_mul(albedo(atlas, texels, part[i], uv[i]), grad_image[samples.first + i / samples.spp])
        for j in range(2):
            arrival = arrivals[i, j]
            if arrival[2] > 0.0:
                at = wp.vec2(arrival[0], arrival[1])
                row, col, w = emitter.taps(grad_light.shape[0], grad_light.shape[1], at)
                for k in range(4):
                    wp.atomic_add(grad_light, row[k], col[k], wp.vec3d(g * (arrival[2] * w[k])))
