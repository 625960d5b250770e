// The opacity of a part where the ray meets its triangle. alpha_kernels.py puts this into traverse.h, at each triangle.
Word id;
id.f = face;
const wp::vec3i layout = alpha.layout.data[alpha.face_part.data[id.i]];
float opacity = alpha.texels.data[layout[0]];
if (layout[1] * layout[2] > 1) {
    auto texel = [](int i, int n, bool repeat) {
        return repeat ? (i % n + n) % n : i < 0 ? 0 : i < n ? i : n - 1;
    };
    const int* corner = alpha.corners.data + size_t(id.i) * 3;
    const wp::vec2 p = alpha.uv.data[corner[0]], q = alpha.uv.data[corner[1]], r = alpha.uv.data[corner[2]];
    const float x = (p[0] * u + q[0] * v + r[0] * w) / determinant * (float)layout[2] - 0.5f;
    const float y = (p[1] * u + q[1] * v + r[1] * w) / determinant * (float)layout[1] - 0.5f;
    const int col = (int)floorf(x), row = (int)floorf(y);
    const float right = x - (float)col, above = y - (float)row;
    const int c0 = texel(col, layout[2], alpha.repeat_u), c1 = texel(col + 1, layout[2], alpha.repeat_u);
    const float* low = alpha.texels.data + layout[0] + texel(row, layout[1], alpha.repeat_v) * layout[2];
    const float* high = alpha.texels.data + layout[0] + texel(row + 1, layout[1], alpha.repeat_v) * layout[2];
    opacity = (low[c0] * (1.0f - right) + low[c1] * right) * (1.0f - above)
        + (high[c0] * (1.0f - right) + high[c1] * right) * above;
}
