"""The score of a run on held-out assets, its supervised oracle, and the leakage probe."""
