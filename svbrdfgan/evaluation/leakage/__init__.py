"""Shortcuts: what would tell real from fake without looking at the texture, found before a training run is spent."""

from svbrdfgan.evaluation.leakage.probe import Probed, probe_shortcuts

__all__ = ["Probed", "probe_shortcuts"]
