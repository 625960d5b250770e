"""The leakage probe: what tells real from fake besides the texture, found before a training run is spent."""

from svbrdfgan.evaluation.leakage.probe import ProbeResult, probe_shortcuts

__all__ = ["ProbeResult", "probe_shortcuts"]
