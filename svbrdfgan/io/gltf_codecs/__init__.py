"""Decoders of what glTF files compress: geometry by Draco and meshopt, and pictures."""
