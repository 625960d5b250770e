"""What generators read of the subjects of exemplars; of windows there may be too many to hold."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import torch
from jaxtyping import Int
from torch import Tensor

from svbrdfgan.data.exemplars import Exemplars
from svbrdfgan.networks.inputs import Inputs
from svbrdfgan.scene.subject import Subject
from svbrdfgan.utils.copy_async import copy_async
from svbrdfgan.utils.memory_cache import MemoryCache

_SHARE = 0.125


class WindowInputs:
    """The generator's input for each window, read when it is picked. Those used last stay on the device.

    What it picks is, to the bit, what `Inputs` of all windows would pick. Whole maps that windows are cut from stay on
    the device, too; they do not count towards the budget.

    Args:
        subjects: the windows.
        device: where the inputs are wanted.
        cache_bytes: memory for those that stay; None takes an eighth of the device's, and 0 keeps only the last one.
    """

    def __init__(self, subjects: Sequence[Subject], device: torch.device, cache_bytes: int | None = None) -> None:
        self._subjects, self.device = subjects, device
        self._held: MemoryCache[int, Inputs] = MemoryCache(cache_bytes, share=_SHARE)
        self._wholes: dict[int, tuple[Tensor, Tensor]] = {}
        """Whole maps as they were read, and on the device; by the identity of the first."""

    def __len__(self) -> int:
        return len(self._subjects)

    def pick(self, indices: Int[Tensor, " batch"]) -> Inputs:
        """Those of some windows, images channels last in memory."""
        return Inputs.joined([self._one(number) for number in indices.tolist()])

    def _one(self, number: int) -> Inputs:
        found = self._held.get(number)
        if found is None:
            found = self._on_device(self._subjects[number].inputs)
            self._held[number] = found
        return found

    def _on_device(self, inputs: Inputs) -> Inputs:
        geometry, wholes = inputs.geometry.to(memory_format=torch.channels_last), inputs.wholes
        if wholes is not None:
            of, place = (copy_async(values, self.device) for values in (wholes.of, wholes.place))
            wholes = replace(wholes, geometry=self._whole(wholes.geometry), of=of, place=place)
        return Inputs(copy_async(geometry, self.device), wholes)

    def _whole(self, read: Tensor) -> Tensor:
        """A whole map on the device, one tensor for all its windows."""
        if id(read) not in self._wholes:
            self._wholes[id(read)] = read, read.to(self.device, memory_format=torch.channels_last)
        return self._wholes[id(read)][1]


def subject_inputs(exemplars: Exemplars, device: torch.device) -> Inputs | WindowInputs:
    """The generator's input for each subject: held on the device, or read when it is picked if subjects are windows."""
    return WindowInputs(exemplars.subjects, device) if exemplars.windowed else stack_inputs(exemplars, device)


def stack_inputs(exemplars: Exemplars, device: torch.device) -> Inputs:
    """The generator's input for each subject, channels last in memory."""
    return Inputs.joined([subject.inputs for subject in exemplars.subjects]).to(device)
