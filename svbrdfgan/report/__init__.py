"""The report of a run: a self-contained HTML page and an overview picture. Importing this package imports no module."""
