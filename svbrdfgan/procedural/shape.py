"""The parameters of a procedural vehicle, and their valid ranges."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

from svbrdfgan.errors import ConfigError

Range = tuple[float, float]

LIMITS: Mapping[str, Range] = MappingProxyType(
    {
        "width": (0.30, 0.60),
        "height": (0.24, 0.60),
        "clearance": (0.02, 0.10),
        "wheel_radius": (0.05, 0.10),
        "wheel_width": (0.03, 0.08),
        "wheelbase": (0.48, 0.70),
        "front_overhang": (0.13, 0.24),
        "nose": (0.40, 0.75),
        "hood_length": (0.08, 0.36),
        "hood_rise": (0.0, 0.12),
        "windscreen_run": (0.05, 0.25),
        "rear_run": (0.015, 0.25),
        "deck_length": (0.0, 0.45),
        "deck": (0.40, 0.80),
        "roof_arch": (0.0, 0.04),
        "roof_drop": (0.0, 0.06),
        "belt_rise": (0.0, 0.04),
        "tumblehome": (0.02, 0.55),
        "bow": (0.0, 0.08),
        "taper": (0.0, 0.25),
        "flare": (0.0, 0.03),
        "rounding": (0.006, 0.035),
        "glazing": (0.15, 1.0),
        "cladding": (0.0, 0.05),
        "lamps": (0.10, 0.35),
    }
)
"""Least and greatest valid value of each continuous parameter."""


@dataclass(frozen=True)
class VehicleShape:
    """A road vehicle of overall length 1. Lengths are in that unit; `LIMITS` gives the range of each number.

    Attributes:
        width, height: overall, without mirrors.
        clearance: height of the sills above the ground.
        wheel_radius, wheel_width: of the tyres.
        wheelbase: between the axles. front_overhang: from the nose to the front axle.
        nose: height of the hood's leading edge, as a share of `height`.
        hood_length: from the nose to the foot of the windscreen. hood_rise: how much the hood rises over it.
        windscreen_run, rear_run: horizontal extent of the sloping front and rear glass; small values are steep.
        deck_length: from the foot of the rear glass to the tail (boot lid, or bed).
        deck: height of the deck as a share of `height`.
        roof_arch: how far the roof bulges over its ends. roof_drop: how much lower the roof's rear end is.
        belt_rise: how much the window line rises towards the tail.
        tumblehome: inward slope of the cabin's sides (horizontal over vertical).
        bow: how far the nose and tail recede at their sides, seen from above.
        taper: share of the width by which the body narrows towards its ends.
        flare: how far the fenders bulge. rounding: radius over which the long edges are smoothed.
        glazing: share of the cabin's length with side windows, from its front.
        cladding: height of the unpainted band along the sills and around the arches; 0 for none.
        lamps: half the width of a head or tail lamp, as a share of half the vehicle's width.
        open_bed: the deck is an open load bed.
        paint: linear RGB reflectance of the body in [0, 1].

    Raises:
        ConfigError: a number is out of its range, or the proportions leave no room for the cabin or the wheels.
    """

    width: float
    height: float
    clearance: float
    wheel_radius: float
    wheel_width: float
    wheelbase: float
    front_overhang: float
    nose: float
    hood_length: float
    hood_rise: float
    windscreen_run: float
    rear_run: float
    deck_length: float
    deck: float
    roof_arch: float
    roof_drop: float
    belt_rise: float
    tumblehome: float
    bow: float
    taper: float
    flare: float
    rounding: float
    glazing: float
    cladding: float
    lamps: float
    open_bed: bool = False
    paint: tuple[float, float, float] = (0.6, 0.6, 0.6)

    def __post_init__(self) -> None:
        for name, (low, high) in LIMITS.items():
            value = getattr(self, name)
            if not low <= value <= high:
                raise ConfigError(f"vehicle {name} is {value}; wanted {low} to {high}.")
        if len(self.paint) != 3 or not all(0.0 <= channel <= 1.0 for channel in self.paint):
            raise ConfigError(f"vehicle paint is {self.paint}; wanted three linear reflectances between 0 and 1.")
        if self.roof_length < 0.05:
            raise ConfigError(
                f"vehicle roof would be {self.roof_length:.3f} long; wanted at least 0.05: "
                "shorten hood_length, windscreen_run, rear_run or deck_length."
            )
        if self.front_overhang + self.wheelbase > 1.0 - 1.4 * self.wheel_radius:
            raise ConfigError("vehicle rear wheels stand behind its tail; shorten front_overhang or wheelbase.")

    @property
    def roof_length(self) -> float:
        return 1.0 - self.hood_length - self.windscreen_run - self.rear_run - max(self.deck_length, 0.03)

    @property
    def axles(self) -> tuple[float, float]:
        """z of the front and the rear axle."""
        front = 0.5 - self.front_overhang
        return front, front - self.wheelbase
