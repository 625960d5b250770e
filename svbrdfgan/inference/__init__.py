"""A trained generator on a mesh of one's own: painting a layer, writing the weathered mesh."""
