"""The thesis's experiments (chapter 5) and further ones: each is a YAML file that is run to a table and pictures."""
