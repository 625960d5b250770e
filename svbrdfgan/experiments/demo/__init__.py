"""The demonstration: two configuration files and what runs them."""
