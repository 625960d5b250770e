"""What users write: strictly checked records, YAML files, distributions, and sentences for what is wrong."""
