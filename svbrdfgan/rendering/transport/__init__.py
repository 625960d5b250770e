"""Light transport: the image of a Lambertian surface as an affine function of its textures, traced once and stored."""
