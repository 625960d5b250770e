"""Deprecated alias of `svbrdfgan.rendering.validation`; it goes with version 0.3."""

import warnings

from svbrdfgan.rendering.validation import check_cotangent, check_device, check_radiance, check_render, check_transport

__all__ = ["check_cotangent", "check_device", "check_radiance", "check_render", "check_transport"]

warnings.warn(
    "svbrdfgan.refusals is now svbrdfgan.rendering.validation; import from there.", DeprecationWarning, stacklevel=2
)
