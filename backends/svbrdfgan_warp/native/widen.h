// Makes node `wide` of the wide tree from node `sources[wide]` of the binary tree, with up to eight children.
const int LEAF = 3;  // most triangles in a leaf
auto triangles = [&](int node) { return binary.counts.data[node]; };
auto area = [&](int node) {
    const wp::vec3 d = binary.upper.data[node] - binary.lower.data[node];
    return d[0] * d[1] + d[1] * d[2] + d[2] * d[0];
};
// Replace the largest child by its two until there are eight, or all are leaves.
const int root = grown.sources.data[wide];
int child[8];
int count = 1;
child[0] = root;
while (count < 8) {
    int largest = -1;
    float most = -1.0f;
    for (int k = 0; k < count; ++k)
        if ((triangles(child[k]) > LEAF || (count == 1 && child[k] >= n)) && area(child[k]) > most) {
            most = area(child[k]);
            largest = k;
        }
    if (largest < 0)
        break;
    const wp::vec2i pair = binary.children.data[child[largest] - n];
    child[largest] = pair[0];
    child[count++] = pair[1];
}
// Each child takes the free slot that fits its octant best, so that any ray can visit the slots roughly front to back.
const wp::vec3 low = binary.lower.data[root];
const wp::vec3 high = binary.upper.data[root];
int slots[8] = {-1, -1, -1, -1, -1, -1, -1, -1};
bool placed[8] = {false, false, false, false, false, false, false, false};
for (int round = 0; round < count; ++round) {
    float best = -3.4e38f;
    int best_child = 0, best_slot = 0;
    for (int k = 0; k < count; ++k) {
        if (placed[k])
            continue;
        const wp::vec3 off = binary.lower.data[child[k]] + binary.upper.data[child[k]] - low - high;
        for (int s = 0; s < 8; ++s) {
            if (slots[s] >= 0)
                continue;
            const float fitness
                = (s & 4 ? off[0] : -off[0]) + (s & 2 ? off[1] : -off[1]) + (s & 1 ? off[2] : -off[2]);
            if (fitness > best) {
                best = fitness;
                best_child = k;
                best_slot = s;
            }
        }
    }
    placed[best_child] = true;
    slots[best_slot] = best_child;
}
// A grid of 255 steps over the bounds; steps are powers of two, so that decoding is exact.
int exponent[3];
float step[3];
for (int axis = 0; axis < 3; ++axis) {
    const float size = (high[axis] - low[axis]) / 255.0f;
    int e = size > 0.0f ? (int)(ceilf(log2f(size))) : -100;
    e = e < -100 ? -100 : e;
    while (ldexpf(255.0f, e) < high[axis] - low[axis] || low[axis] + ldexpf(255.0f, e) < high[axis])
        ++e;
    exponent[axis] = e;
    step[axis] = ldexpf(1.0f, e);
}
int inner_children = 0, leaf_triangles = 0;
for (int s = 0; s < 8; ++s)
    if (slots[s] >= 0) {
        const int node = child[slots[s]];
        if (triangles(node) > LEAF) ++inner_children;
        else leaf_triangles += triangles(node);
    }
#ifdef __CUDA_ARCH__
const int child_base = atomicAdd(&grown.counters.data[0], inner_children);
const int triangle_base = atomicAdd(&grown.counters.data[1], leaf_triangles);
#else
const int child_base = grown.counters.data[0], triangle_base = grown.counters.data[1];
grown.counters.data[0] += inner_children;
grown.counters.data[1] += leaf_triangles;
#endif
unsigned char bytes[56];  // per child: meta, then lower x y z and upper x y z
for (int k = 0; k < 56; ++k)
    bytes[k] = 0;
unsigned int inner_mask = 0;
int next_child = child_base, next_triangle = 0;
for (int s = 0; s < 8; ++s) {
    if (slots[s] < 0)
        continue;
    const int node = child[slots[s]];
    const int many = triangles(node);
    if (many > LEAF) {
        inner_mask |= 1u << s;
        bytes[s] = (unsigned char)(32 + 24 + s);
        grown.sources.data[next_child++] = node;
    } else {
        bytes[s] = (unsigned char)((((1 << many) - 1) << 5) | next_triangle);
        int walk[3] = {node};
        for (int size = 1, placed = 0; size > 0;) {
            const int next = walk[--size];
            if (next < n) {
                grown.order.data[triangle_base + next_triangle + placed++] = next;
            } else {
                walk[size++] = binary.children.data[next - n][1];
                walk[size++] = binary.children.data[next - n][0];
            }
        }
        next_triangle += many;
    }
    for (int axis = 0; axis < 3; ++axis) {
        const float l = binary.lower.data[node][axis], h = binary.upper.data[node][axis];
        int a = (int)(floorf((l - low[axis]) / step[axis]));
        int b = (int)(ceilf((h - low[axis]) / step[axis]));
        a = a < 0 ? 0 : a > 255 ? 255 : a;
        b = b < 0 ? 0 : b > 255 ? 255 : b;
        while (a > 0 && low[axis] + (float)(a) * step[axis] > l) --a;
        while (b < 255 && low[axis] + (float)(b) * step[axis] < h) ++b;
        bytes[8 + axis * 8 + s] = (unsigned char)a;
        bytes[32 + axis * 8 + s] = (unsigned char)b;
    }
}
unsigned int* out = grown.nodes.data + size_t(wide) * 20;
for (int axis = 0; axis < 3; ++axis) {
    union { float f; unsigned int u; } word;
    word.f = low[axis];
    out[axis] = word.u;
}
out[3] = (unsigned int)(exponent[0] + 127) | (unsigned int)(exponent[1] + 127) << 8
    | (unsigned int)(exponent[2] + 127) << 16 | inner_mask << 24;
out[4] = (unsigned int)child_base;
out[5] = (unsigned int)triangle_base;
for (int k = 0; k < 14; ++k)
    out[6 + k] = (unsigned int)bytes[4 * k] | (unsigned int)bytes[4 * k + 1] << 8
        | (unsigned int)bytes[4 * k + 2] << 16 | (unsigned int)bytes[4 * k + 3] << 24;
