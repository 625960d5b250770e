"""Helpers without knowledge of rendering or learning: processes, progress, device copies, Triton, deprecated names."""
