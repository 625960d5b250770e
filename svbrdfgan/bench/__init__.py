"""How long renderers take and how much memory, ours and others, on the same work in one run: `svbrdfgan bench`."""
