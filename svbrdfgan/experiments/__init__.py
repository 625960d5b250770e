"""The thesis's experiments (chapter 5) and ours: each a declarative file, run to a table and pictures."""
