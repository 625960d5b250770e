"""Read and write meshes, textures, images and environments. Only this package handles sRGB and file row order."""
