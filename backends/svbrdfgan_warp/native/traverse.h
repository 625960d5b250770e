// Traces a ray from `start` along `d` through the tree of bvh.py: ON_HIT is done at each triangle nearer than `nearest`,
// and RESULT at the end. bvh_kernels.py replaces both words by code.
#ifdef __CUDA_ARCH__
#define HIGHEST(x) (31 - __clz(x))
#define BITS(x) __popc(x)
// A GPU's integer unit, which shifts, masks and compares, holds the traversal: of 311 instructions for a node it took 209,
// and takes 148. So half of the bytes become floats by arithmetic, which has time: 2^23 + byte is made of bits, and 2^23
// subtracted. Bounds are compared as integers, since one instruction takes the greatest of three: floats from 0 on are
// ordered like their bits, and those below 0 have bits below 0, so that all that matters of them is kept.
#define BYTE(w, k) ((k) == 1 || (k) == 2 ? __uint_as_float(__byte_perm(w, 0x4B000000u, 0x7440u | (k))) - 8388608.0f \
                                         : (float)((w) >> 8 * (k) & 0xFFu))
#define BOUND(x) __float_as_int(x)
#define LESSER(a, b) min(a, b)
#define GREATER(a, b) max(a, b)
typedef int Bound;
#else
#define HIGHEST(x) (31 - __builtin_clz(x))
#define BITS(x) __builtin_popcount(x)
#define BYTE(w, k) (float)((w) >> 8 * (k) & 0xFFu)
#define BOUND(x) (x)
#define LESSER(a, b) wp::min(a, b)
#define GREATER(a, b) wp::max(a, b)
typedef float Bound;
#endif
union Word { float f; unsigned int u; int i; };
const float tiny = 1.0e-20f;
const wp::vec3 o = start;
const wp::vec3 inverse(
    1.0f / (fabsf(d[0]) > tiny ? d[0] : wp::copysign(tiny, d[0])),
    1.0f / (fabsf(d[1]) > tiny ? d[1] : wp::copysign(tiny, d[1])),
    1.0f / (fabsf(d[2]) > tiny ? d[2] : wp::copysign(tiny, d[2])));
const bool back_x = inverse[0] < 0.0f, back_y = inverse[1] < 0.0f, back_z = inverse[2] < 0.0f;
const unsigned int octant = (back_x ? 0u : 4u) | (back_y ? 0u : 2u) | (back_z ? 0u : 1u);
const unsigned int octants = octant * 0x01010101u;

// Woop's shear: the largest axis of the direction becomes z.
const float ax = fabsf(d[0]), ay = fabsf(d[1]), az = fabsf(d[2]);
const int kz = ax > ay ? (ax > az ? 0 : 2) : (ay > az ? 1 : 2);
const float dz = kz == 0 ? d[0] : kz == 1 ? d[1] : d[2];
const float sx = (kz == 0 ? d[1] : kz == 1 ? d[2] : d[0]) / dz;
const float sy = (kz == 0 ? d[2] : kz == 1 ? d[0] : d[1]) / dz;
const float sz = 1.0f / dz;

const unsigned int* words = nodes.data;
float nearest = 3.0e38f;
Word found;
found.i = -1;
float found_u = 0.0f, found_v = 0.0f;

unsigned int stack[2 * 64];
int top = 0;
unsigned int group_base = 0, group = 0x80000000u;  // 8 bits: children yet to visit; low 8 bits: slots with inner children
while (true) {
    unsigned int triangle_base = 0, triangle_group = 0;
    if (group > 0x00FFFFFFu) {
        const int bit = HIGHEST(group);
        const unsigned int inner = group & 0xFFu;
        group &= ~(1u << bit);
        if (group > 0x00FFFFFFu && top < 64) {
            stack[2 * top] = group_base;
            stack[2 * top + 1] = group;
            ++top;
        }
        const unsigned int slot = (unsigned int)(bit - 24) ^ octant;
        const unsigned int index = group_base + BITS(inner & ~(0xFFFFFFFFu << slot));
        const unsigned int* node = words + size_t(index) * 20;
#ifdef __CUDA_ARCH__
        const uint4* wide = (const uint4*)node;
        const uint4 n0 = __ldg(wide), n1 = __ldg(wide + 1), n2 = __ldg(wide + 2), n3 = __ldg(wide + 3), n4 = __ldg(wide + 4);
        const unsigned int w[20] = {n0.x, n0.y, n0.z, n0.w, n1.x, n1.y, n1.z, n1.w, n2.x, n2.y,
                                    n2.z, n2.w, n3.x, n3.y, n3.z, n3.w, n4.x, n4.y, n4.z, n4.w};
#else
        const unsigned int* w = node;
#endif
        Word px, py, pz, ex, ey, ez;
        px.u = w[0]; py.u = w[1]; pz.u = w[2];
        ex.u = (w[3] & 0xFFu) << 23; ey.u = (w[3] >> 8 & 0xFFu) << 23; ez.u = (w[3] >> 16 & 0xFFu) << 23;
        const float gx = ex.f * inverse[0], gy = ey.f * inverse[1], gz = ez.f * inverse[2];
        const float bx = (px.f - o[0]) * inverse[0], by = (py.f - o[1]) * inverse[1], bz = (pz.f - o[2]) * inverse[2];
        unsigned int hits = 0;
#pragma unroll
        for (int half = 0; half < 2; ++half) {
            const unsigned int meta = w[6 + half];
            const unsigned int is_inner = (meta & (meta << 1)) & 0x10101010u;
            const unsigned int inner_bytes = (is_inner >> 4) * 0xFFu;
            const unsigned int places = (meta ^ (octants & inner_bytes)) & 0x1F1F1F1Fu;
            const unsigned int bits = (meta >> 5) & 0x07070707u;
            const unsigned int lx = w[8 + half], ly = w[10 + half], lz = w[12 + half];
            const unsigned int hx = w[14 + half], hy = w[16 + half], hz = w[18 + half];
            const unsigned int near_x = back_x ? hx : lx, far_x = back_x ? lx : hx;
            const unsigned int near_y = back_y ? hy : ly, far_y = back_y ? ly : hy;
            const unsigned int near_z = back_z ? hz : lz, far_z = back_z ? lz : hz;
#pragma unroll
            for (int k = 0; k < 4; ++k) {
                const int shift = 8 * k;
                const Bound enter = GREATER(
                    GREATER(BOUND(BYTE(near_x, k) * gx + bx), BOUND(BYTE(near_y, k) * gy + by)),
                    GREATER(BOUND(BYTE(near_z, k) * gz + bz), (Bound)0));
                const Bound leave = LESSER(
                    LESSER(BOUND(BYTE(far_x, k) * gx + bx), BOUND(BYTE(far_y, k) * gy + by)),
                    LESSER(BOUND(BYTE(far_z, k) * gz + bz), BOUND(nearest)));
                if (enter <= leave)
                    hits |= (bits >> shift & 0xFFu) << (places >> shift & 0x1Fu);
            }
        }
        group_base = w[4];
        triangle_base = w[5];
        group = (hits & 0xFF000000u) | w[3] >> 24;
        triangle_group = hits & 0x00FFFFFFu;
    }
    while (triangle_group) {
        const int bit = HIGHEST(triangle_group);
        triangle_group &= ~(1u << bit);
#ifdef __CUDA_ARCH__
        const float4* corner = (const float4*)triangles.data + size_t(triangle_base + bit) * 3;
        const float4 A = __ldg(corner), B = __ldg(corner + 1), C = __ldg(corner + 2);
        const float face = A.w;
        const wp::vec3 a(A.x - o[0], A.y - o[1], A.z - o[2]);
        const wp::vec3 b(B.x - o[0], B.y - o[1], B.z - o[2]);
        const wp::vec3 c(C.x - o[0], C.y - o[1], C.z - o[2]);
#else
        const wp::vec4* corner = triangles.data + size_t(triangle_base + bit) * 3;
        const float face = corner[0][3];
        const wp::vec3 a(corner[0][0] - o[0], corner[0][1] - o[1], corner[0][2] - o[2]);
        const wp::vec3 b(corner[1][0] - o[0], corner[1][1] - o[1], corner[1][2] - o[2]);
        const wp::vec3 c(corner[2][0] - o[0], corner[2][1] - o[1], corner[2][2] - o[2]);
#endif
        const float a_z = kz == 0 ? a[0] : kz == 1 ? a[1] : a[2];
        const float b_z = kz == 0 ? b[0] : kz == 1 ? b[1] : b[2];
        const float c_z = kz == 0 ? c[0] : kz == 1 ? c[1] : c[2];
        const float a_x = (kz == 0 ? a[1] : kz == 1 ? a[2] : a[0]) - sx * a_z;
        const float a_y = (kz == 0 ? a[2] : kz == 1 ? a[0] : a[1]) - sy * a_z;
        const float b_x = (kz == 0 ? b[1] : kz == 1 ? b[2] : b[0]) - sx * b_z;
        const float b_y = (kz == 0 ? b[2] : kz == 1 ? b[0] : b[1]) - sy * b_z;
        const float c_x = (kz == 0 ? c[1] : kz == 1 ? c[2] : c[0]) - sx * c_z;
        const float c_y = (kz == 0 ? c[2] : kz == 1 ? c[0] : c[1]) - sy * c_z;
        float u = c_x * b_y - c_y * b_x;
        float v = a_x * c_y - a_y * c_x;
        float w = b_x * a_y - b_y * a_x;
        if (u == 0.0f || v == 0.0f || w == 0.0f) {
            u = (float)((double)(c_x) * (double)(b_y) - (double)(c_y) * (double)(b_x));
            v = (float)((double)(a_x) * (double)(c_y) - (double)(a_y) * (double)(c_x));
            w = (float)((double)(b_x) * (double)(a_y) - (double)(b_y) * (double)(a_x));
        }
        if ((u < 0.0f || v < 0.0f || w < 0.0f) && (u > 0.0f || v > 0.0f || w > 0.0f))
            continue;
        const float determinant = u + v + w;
        if (determinant == 0.0f)
            continue;
        const float t = (u * a_z + v * b_z + w * c_z) * sz / determinant;
        if (!(t >= 0.0f && t < nearest))
            continue;
        ON_HIT
    }
    if (group <= 0x00FFFFFFu) {
        if (top == 0)
            break;
        --top;
        group_base = stack[2 * top];
        group = stack[2 * top + 1];
    }
}
#undef HIGHEST
#undef BITS
#undef BYTE
#undef BOUND
#undef LESSER
#undef GREATER
RESULT
