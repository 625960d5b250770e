"""Configuration: strict models, YAML files, distributions, plugin and part choices, and error messages."""
