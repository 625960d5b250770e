"""glTF: one representation of a whole file, read and written with nothing lost, and what is made of it."""
