"""What knows nothing of rendering or learning: processes, progress display, device copies, Triton's availability."""
