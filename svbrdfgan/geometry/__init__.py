"""Triangle geometry: normals, areas, sampling, cell grids, subdivision, rasterisation in UV space and inner layers."""
