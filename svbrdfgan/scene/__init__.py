"""Scene descriptions, the assets that they name, and their loader."""
