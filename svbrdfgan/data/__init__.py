"""Data sets: declared distributions in, exemplar pictures with their whole scenes out, and back into memory."""
