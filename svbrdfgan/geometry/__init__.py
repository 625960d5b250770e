"""Triangles: shading normals, subdivision, rasterising over the UV square, and which surfaces lie beneath others."""
