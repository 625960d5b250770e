"""Triangles: normals, areas, samples, cells, subdivision, rasterising over UV, and which surfaces lie under others."""
