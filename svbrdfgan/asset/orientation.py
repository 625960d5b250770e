"""Find the nose and the roof of a vehicle, or check the ones that a user gives."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from jaxtyping import Float
from numpy import ndarray
from scipy.special import softmax

from svbrdfgan.asset.evidence import Evidence, gather
from svbrdfgan.asset.nose import NOSE, nose
from svbrdfgan.asset.stance import STANCE, asymmetry, stance, standing
from svbrdfgan.errors import ConfigError
from svbrdfgan.types import Mesh

AXES = MappingProxyType(
    {sign + name: np.eye(3)[axis] * (1.0 if sign == "+" else -1.0) for axis, name in enumerate("XYZ") for sign in "+-"}
)
"""The six directions that a nose or a roof can have, and their unit vectors."""

_UP_PRIOR = MappingProxyType({"+Y": 2.0, "+Z": 0.5})  # glTF says Y, and Z is common elsewhere; logarithms of odds
_FRONT_PRIOR = MappingProxyType({"+Z": 0.1})  # glTF's, where nothing else tells
_SURE = 0.95
_AGREEMENT = 0.5  # of all that speaks for either end, what is left after the contrary is taken off
_WHEELS_ENOUGH = 0.7  # of `standing`: three on two axles
_NAMES_ENOUGH = 2

_TOLD = MappingProxyType(
    {
        "names": "the names of parts",
        "lower_half": "the lower half of the body",
        "bonnet": "the longer bonnet",
        "bed": "the cabin before the load bed",
        "sunk": "the cabin before the load bed",
        "leaning": "the slope of the windscreen",
        "overhang": "the shorter overhang before the wheels",
        "rear_axles": "the axles at the rear",
        "rear_wheels": "the larger wheels at the rear",
        "mirrors": "the mirrors",
        "glass_place": "the place of the glass",
        "glass_leaning": "the slope of the glass",
        "narrower": "the narrower end",
    }
)


@dataclass(frozen=True)
class Orientation:
    """Where a vehicle's nose and roof are, in the axes of its file.

    Attributes:
        front: one of `AXES`.
        up: one of `AXES`, perpendicular to `front`.
        front_sure: False if the nose may as well be elsewhere, and a person should look.
        up_sure: likewise.
        reason: one sentence for the user.
    """

    front: str
    up: str
    front_sure: bool
    up_sure: bool
    reason: str

    def __str__(self) -> str:
        """One sentence for the user, loud where it is a guess."""
        told = f"the nose is at {self.front} and the roof at {self.up}: {self.reason.rstrip('.')}"
        unsure = [option for option, sure in (("--front", self.front_sure), ("--up", self.up_sure)) if not sure]
        return told if not unsure else f"warning: {told}; look, and say {' and '.join(unsure)}"

    def matrix(self) -> Float[ndarray, "3 3"]:
        """The rotation from the file's axes to the project's: the roof to +Y, the nose to +Z."""
        return _rotation(self.front, self.up)


def axes(front: str | None, up: str | None) -> tuple[str | None, str | None]:
    """What a user gives as nose and roof, as keys of `AXES`: "x" and "+x" are "+X". None stays None.

    Raises:
        ConfigError: one is no axis, or both lie along the same.
    """
    front, up = _axis("front", front), _axis("up", up)
    if front is not None and up is not None and front[1] == up[1]:
        raise ConfigError(
            f"front {front} and up {up} lie along one axis; a nose and a roof are at right angles: give another."
        )
    return front, up


def find_orientation(
    mesh: Mesh, *, names: Sequence[str] | None = None, front: str | None = None, up: str | None = None
) -> Orientation:
    """Where the nose and the roof of a vehicle of any size, place and axes are, and whether that is sure.

    It is found from wheels, symmetry, the body's shape and the names of parts. Of what has neither wheels on the ground
    nor parts named as a vehicle's, it is glTF's convention, roof at +Y and nose at +Z, and not sure. A front or an up
    that is given is taken as sure, and the other is found under it. The same mesh has the same orientation each time.

    Args:
        names: a further name for each of `mesh.parts`, such as its node's.
        front: the nose, if known; one of `AXES`.
        up: the roof, if known; likewise.

    Raises:
        ConfigError: as for `axes`.
        ValueError: there is not one name for each part.
    """
    front, up = axes(front, up)
    if front is not None and up is not None:
        return Orientation(front, up, True, True, f"The nose at {front} and the roof at {up} were given.")
    evidence = gather(mesh, names)
    options = [pair for pair in _pairs() if _fits(pair, front, up)]
    likely = _likelihoods(evidence, options)
    return _decided(evidence, options, likely, front, up)


def _axis(option: str, given: str | None) -> str | None:
    if given is None:
        return None
    plain = given.strip().upper()
    plain = plain if plain[:1] in ("+", "-") else f"+{plain}"
    if plain not in AXES:
        raise ConfigError(f"{option} is {given!r}; wanted one of {', '.join(AXES)}.")
    return plain


def _rotation(front: str, up: str) -> Float[ndarray, "3 3"]:
    return np.stack([np.cross(AXES[up], AXES[front]), AXES[up], AXES[front]])


def _pairs() -> list[tuple[str, str]]:
    """All noses and roofs, glTF's first, so that it wins a tie."""
    order = ("+Z", "-Z", "+X", "-X", "-Y", "+Y")
    ups = ("+Y", "+Z", "-Y", "-Z", "+X", "-X")
    return [(front, up) for up in ups for front in order if front[1] != up[1]]


def _fits(pair: tuple[str, str], front: str | None, up: str | None) -> bool:
    return front in (None, pair[0]) and up in (None, pair[1])


def _likelihoods(evidence: Evidence, options: Sequence[tuple[str, str]]) -> Float[ndarray, " options"]:
    """The probability of each nose and roof, which add up to 1, if the mesh is a vehicle."""
    asymmetric, weights = asymmetry(evidence), np.array(list(STANCE.values()))
    scores = []
    for front, up in options:
        matrix = _rotation(front, up)
        turned = evidence.turned(matrix)
        ahead = -float(np.logaddexp(0.0, -_ahead(turned).sum() - _FRONT_PRIOR.get(front, 0.0)))
        stands = float(stance(turned, np.abs(matrix) @ asymmetric) @ weights)
        scores.append(stands + ahead + _UP_PRIOR.get(up, 0.0))
    return np.asarray(softmax(scores))


def _ahead(turned: Evidence) -> Float[ndarray, " numbers"]:
    """What each of the numbers of `NOSE` says for the nose at +Z, as a logarithm of odds."""
    return nose(turned) * np.array(list(NOSE.values()))


def _decided(
    evidence: Evidence,
    options: Sequence[tuple[str, str]],
    likely: Float[ndarray, " options"],
    front: str | None,
    up: str | None,
) -> Orientation:
    best = options[int(likely.argmax())]
    chance_up = float(sum(chance for pair, chance in zip(options, likely, strict=True) if pair[1] == best[1]))
    turned = evidence.turned(_rotation(*best))
    wheels = standing(turned)[0] >= _WHEELS_ENOUGH
    if not wheels and sum(bool(said.any()) for said in evidence.said.values()) < _NAMES_ENOUGH:
        return _convention(options, front, up)
    up_sure = up is not None or chance_up >= _SURE
    likely_front = up_sure and float(likely.max()) >= _SURE
    front_sure = front is not None or (likely_front and _supported(_ahead(turned), wheels))
    return Orientation(*best, front_sure, up_sure, _reason(turned, best, (front_sure, up_sure), wheels))


def _supported(ahead: Float[ndarray, " numbers"], wheels: bool) -> bool:
    """Whether names tell the nose, or else shapes agree on it, of what stands on wheels.

    A tank or a tractor's shovel is unlike the vehicles that the weights were fitted to; there they contradict.
    """
    named = ahead[list(NOSE).index("names")] > 0.5 * NOSE["names"]
    return bool(named or (wheels and ahead.sum() > _AGREEMENT * np.abs(ahead).sum()))


def _convention(options: Sequence[tuple[str, str]], front: str | None, up: str | None) -> Orientation:
    best = options[0]
    reason = f"No wheels or parts of a vehicle were found, so nose {best[0]} and roof {best[1]} are only a guess."
    return Orientation(*best, front is not None, up is not None, reason)


def _reason(turned: Evidence, best: tuple[str, str], sure: tuple[bool, bool], wheels: bool) -> str:
    """What told most, and what is only a guess."""
    ahead = dict(zip(NOSE, _ahead(turned).tolist(), strict=True))
    told = _TOLD[max(ahead, key=lambda name: ahead[name])]
    roof = "wheels on the ground" if wheels else "symmetry, shape and named parts"
    unsure = [f"{what} is a guess" for what, is_sure in zip(("the nose", "the roof"), sure, strict=True) if not is_sure]
    return f"Roof at {best[1]} by {roof}, nose at {best[0]} by {told}" + "".join(f"; {each}" for each in unsure) + "."
