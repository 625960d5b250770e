"""Trained models that are shipped: each is a folder here, named after the model."""
