"""The report of a run: a self-contained HTML page, an overview picture, and what both consist of."""
