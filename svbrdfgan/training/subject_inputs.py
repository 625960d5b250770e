"""What generators read of the subjects of exemplars; of windows there may be too many to hold."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import torch
from jaxtyping import Int
from torch import Tensor

from svbrdfgan.data.exemplars import Exemplars
from svbrdfgan.networks.inputs import Inputs, Wholes
from svbrdfgan.scene.subject import Subject
from svbrdfgan.utils.copy_async import copy_async


class WindowInputs:
    """The generator's input for each window, read when it is picked. Whole maps stay on the device from then on.

    What it picks is, to the bit, what `Inputs` of all windows would pick.

    Args:
        subjects: the windows.
        device: where the inputs are wanted.
    """

    def __init__(self, subjects: Sequence[Subject], device: torch.device) -> None:
        self._subjects, self.device = subjects, device
        self._wholes: dict[int, tuple[Tensor, Tensor]] = {}
        """Those on the device, by the identity of the tensor that each was copied from; it is held with it."""

    def __len__(self) -> int:
        return len(self._subjects)

    def pick(self, indices: Int[Tensor, " batch"]) -> Inputs:
        """Those of some windows, images channels last in memory."""
        picked = Inputs.joined([self._with_held_whole(self._subjects[number].inputs) for number in indices.tolist()])
        geometry, wholes = picked.geometry.to(memory_format=torch.channels_last), picked.wholes
        if wholes is not None:
            of, place = (copy_async(values, self.device) for values in (wholes.of, wholes.place))
            wholes = replace(wholes, of=of, place=place)
        return Inputs(copy_async(geometry, self.device), wholes)

    def _with_held_whole(self, inputs: Inputs) -> Inputs:
        wholes = inputs.wholes
        if wholes is None:
            return inputs
        return replace(inputs, wholes=replace(wholes, geometry=self._held(wholes)))

    def _held(self, wholes: Wholes) -> Tensor:
        own = wholes.geometry
        if id(own) not in self._wholes:
            self._wholes[id(own)] = own, own.to(self.device, memory_format=torch.channels_last)
        return self._wholes[id(own)][1]


def subject_inputs(exemplars: Exemplars, device: torch.device) -> Inputs | WindowInputs:
    """The generator's input for each subject: held on the device, or read when it is picked if subjects are windows."""
    if exemplars.windowed:
        return WindowInputs(exemplars.subjects, device)
    return stack_inputs(exemplars, device)


def stack_inputs(exemplars: Exemplars, device: torch.device) -> Inputs:
    """The generator's input for each subject, channels last in memory."""
    return Inputs.joined([subject.inputs for subject in exemplars.subjects]).to(device)
