"""Warp kernels of the primitives that have one shape in each cell; `noise_reference` defines them.

A point's place in its cell is exact in float32. So results are within float32 rounding of the reference, however far
from the origin.
"""

# mypy: ignore-errors
# ruff: noqa: UP018 - Warp's way to declare a variable

import math

import warp as wp

from svbrdfgan.weathering.hash_kernels import four_numbers, hashed, jitter, next_hash, number12, number16, smoothstep
from svbrdfgan.weathering.noise_reference import MOST_BEND, MOST_WIDTH

wp.set_module_options({"enable_backward": False})

BEND, WIDTH, STRETCH = wp.constant(MOST_BEND), wp.constant(MOST_WIDTH), wp.constant(math.hypot(1.0, MOST_BEND))


@wp.func
def deepest_spot(p: wp.vec3, share: float, stream: wp.uint64):
    """The hash of a point's spot, how deep the point lies in it, and the gradient of that."""
    x, y, z = wp.floor(p[0]), wp.floor(p[1]), wp.floor(p[2])
    near = p - wp.vec3(x, y, z)
    best, inside, slope = wp.uint64(0), float(0.0), wp.vec3()
    for n in range(8):
        a, b, c = n >> 2, (n >> 1) & 1, n & 1
        key = hashed(int(x) + a, int(y) + b, int(z) + c, stream)
        present = share - number12(key, 4)
        if present > 0.0:
            radius = (0.125 + 0.375 * number12(key, 3)) * smoothstep(present * 20.0)
            offset = near - wp.vec3(float(a), float(b), float(c)) - jitter(key)
            depth = radius * (1.0 - inside)
            square = wp.dot(offset, offset)
            if square < depth * depth:
                distance = wp.sqrt(square)
                best, inside = key, 1.0 - distance / radius
                slope = offset * (-1.0 / (wp.max(distance, 1.0e-20) * radius))
    return best, inside, slope


@wp.func
def random_numbers(key: wp.uint64, found: bool):
    return four_numbers(next_hash(key)) * wp.where(found, 1.0, 0.0)


@wp.kernel
def spots(
    points: wp.array(dtype=wp.vec3),
    share: wp.array(dtype=float),
    stream: wp.uint64,
    inside: wp.array(dtype=float),
    random: wp.array(dtype=wp.vec4),
):
    i = wp.tid()
    best, deepest, _ = deepest_spot(points[i], share[i], stream)
    inside[i] = deepest
    random[i] = random_numbers(best, deepest > 0.0)


@wp.kernel
def spots_and_slope(
    points: wp.array(dtype=wp.vec3),
    share: wp.array(dtype=float),
    stream: wp.uint64,
    inside: wp.array(dtype=float),
    random: wp.array(dtype=wp.vec4),
    slope: wp.array(dtype=wp.vec3),
):
    i = wp.tid()
    best, deepest, gradient = deepest_spot(points[i], share[i], stream)
    inside[i] = deepest
    random[i] = random_numbers(best, deepest > 0.0)
    slope[i] = gradient


@wp.kernel
def streaks(
    plane: wp.array(dtype=wp.vec2),
    share: wp.array(dtype=float),
    stream: wp.uint64,
    strength: wp.array(dtype=float),
    along: wp.array(dtype=float),
    head: wp.array(dtype=wp.vec2),
    random: wp.array(dtype=wp.vec4),
):
    i = wp.tid()
    x, y = wp.floor(plane[i][0]), wp.floor(plane[i][1])
    near = plane[i] - wp.vec2(x, y)
    best, strongest, place, to_head = wp.uint64(0), float(0.0), float(0.0), wp.vec2()
    # 0.28 and 1.25 cells are the greatest half width and length
    for row in range(wp.where(near[1] < 0.25, -2, -1), 1):
        for column in range(wp.where(near[0] < 0.28, -1, 0), wp.where(near[0] > 0.72, 2, 1)):
            key = hashed(int(x) + column, int(y) + row, 0, stream)
            present = share[i] - number12(key, 4)
            offset = wp.vec2(float(column) + number12(key, 0), float(row) + number12(key, 1)) - near
            if present > 0.0 and offset[1] < 0.0:
                length, width = number12(key, 2), number12(key, 3)
                t = -offset[1] / (0.35 + 0.9 * length * length)
                a = offset[0] / ((0.06 + 0.22 * width) * (1.0 - 0.5 * t))
                if t < 1.0 and a * a < 1.0:
                    profile = (1.0 - a * a) * wp.pow(1.0 - t, 1.2) * smoothstep(t / 0.06) * smoothstep(present * 10.0)
                    if profile > strongest:
                        best, strongest, place, to_head = key, profile, t, offset
    strength[i] = strongest
    along[i] = place
    head[i] = to_head
    random[i] = random_numbers(best, strongest > 0.0)


@wp.func
def scratch(offset: wp.vec3, normal: wp.vec3, half: float, key: wp.uint64, weight: float):
    """Distance, place along, and weight of a scratch."""
    height = 2.0 * number16(key, 0) - 1.0
    turn = number16(key, 1) * wp.tau
    ring = wp.sqrt(wp.max(0.0, 1.0 - height * height))
    direction = wp.vec3(ring * wp.cos(turn), ring * wp.sin(turn), height)
    toward = direction - normal * wp.dot(normal, direction)
    length = wp.length(toward)
    toward = toward / wp.max(length, 0.3)
    s = wp.dot(offset, toward)
    inner = wp.clamp(s, -half, half)
    bend = BEND * (2.0 * number16(key, 2) - 1.0)
    side = wp.dot(offset, wp.cross(normal, toward)) - bend * inner * inner / half
    across = wp.sqrt((s - inner) * (s - inner) + side * side)
    return wp.vec3(across, inner / half, weight * smoothstep((length - 0.3) * 5.0))


@wp.kernel
def scratches(
    points: wp.array(dtype=wp.vec3),
    normal: wp.array(dtype=wp.vec3),
    share: wp.array(dtype=float),
    stream: wp.uint64,
    across: wp.array(dtype=float),
    along: wp.array(dtype=float),
    weight: wp.array(dtype=float),
    random: wp.array(dtype=wp.vec4),
):
    i = wp.tid()
    p = points[i]
    x, y, z = wp.floor(p[0]), wp.floor(p[1]), wp.floor(p[2])
    near = p - wp.vec3(x, y, z)
    best, rank, nearest = wp.uint64(0), float(1.0e30), wp.vec3(WIDTH, 0.0, 0.0)
    for n in range(8):
        a, b, c = n >> 2, (n >> 1) & 1, n & 1
        key = hashed(int(x) + a, int(y) + b, int(z) + c, stream)
        present = share[i] - number12(key, 4)
        if present > 0.0:
            offset = near - wp.vec3(float(a), float(b), float(c)) - jitter(key)
            half = 0.06 + 0.34 * number12(key, 3) * number12(key, 3)
            reach = half * STRETCH + WIDTH
            depth = wp.dot(normal[i], offset)
            faded = smoothstep(present * 10.0) * (1.0 - depth * depth / (0.25 - reach * reach))
            if faded > 0.0 and wp.dot(offset, offset) - depth * depth < reach * reach:
                found = scratch(offset, normal[i], half, next_hash(key), faded)
                if found[0] < WIDTH and found[0] < rank * found[2]:
                    best, rank, nearest = key, found[0] / found[2], found
    across[i] = nearest[0]
    along[i] = nearest[1]
    weight[i] = nearest[2]
    random[i] = random_numbers(next_hash(best), nearest[2] > 0.0)
