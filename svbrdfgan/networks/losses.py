"""The losses of thesis 4.3.2 and 5.3, and the gradient penalties: functions of logits and images alone.

A loss is a pair of functions of real and fake logits, both of any shape: one that the discriminator minimises and one
that the generator minimises. Penalties are added to the discriminator's.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor

Logits = Float[Tensor, "..."]
Scalar = Float[Tensor, ""]
Critic = Callable[[Float[Tensor, "batch channels height width"]], Logits]


@dataclass(frozen=True)
class GANLoss:
    """Functions of (real logits, fake logits), which the networks minimise; the generator's calls for the real ones."""

    discriminator: Callable[[Logits, Logits], Scalar]
    generator: Callable[[Callable[[], Logits], Logits], Scalar]


def _softplus(logits: Logits) -> Scalar:
    return F.softplus(logits).mean()


LOSSES: Mapping[str, GANLoss] = MappingProxyType(
    {
        # Goodfellow et al. 2014, with their non-saturating generator loss
        "vanilla": GANLoss(
            discriminator=lambda real, fake: _softplus(-real) + _softplus(fake),
            generator=lambda real, fake: _softplus(-fake),
        ),
        # Mao et al. 2017
        "lsgan": GANLoss(
            discriminator=lambda real, fake: 0.5 * ((real - 1).square().mean() + fake.square().mean()),
            generator=lambda real, fake: (fake - 1).square().mean(),
        ),
        # Arjovsky et al. 2017; with `gradient_penalty` it is Gulrajani et al.'s WGAN-GP
        "wgan": GANLoss(
            discriminator=lambda real, fake: fake.mean() - real.mean(),
            generator=lambda real, fake: -fake.mean(),
        ),
        # Jolicoeur-Martineau 2019 (RpGAN); with R1 and R2 it is R3GAN (Huang et al. 2024)
        "relativistic": GANLoss(
            discriminator=lambda real, fake: _softplus(fake - real),
            generator=lambda real, fake: _softplus(real() - fake),
        ),
    }
)


def gradient_square(critic: Critic, pictures: Float[Tensor, "batch channels height width"]) -> Scalar:
    """|gradient of the summed logits|^2, averaged over all logits: R1 on real images, R2 on fakes (Mescheder 2018)."""
    # averaged over logits, one for each patch, so that one weight suits images of any size
    inputs, logits = _evaluate(critic, pictures)
    return _gradient(inputs, logits).square().sum() / logits.numel()


def gradient_penalty(
    critic: Critic,
    real: Float[Tensor, "batch channels height width"],
    fake: Float[Tensor, "batch channels height width"],
    mix: Float[Tensor, " batch"],
) -> Scalar:
    """(|gradient of the mean logit| - 1)^2 at mixtures of real and fake (Gulrajani et al. 2017, equation 3)."""
    between = torch.lerp(fake, real, mix.reshape(-1, 1, 1, 1))
    inputs, logits = _evaluate(critic, between)
    mean_logits = logits.reshape(len(between), -1).mean(dim=1)
    return (_gradient(inputs, mean_logits).flatten(1).norm(dim=1) - 1).square().mean()


def _evaluate(critic: Critic, pictures: Tensor) -> tuple[Tensor, Tensor]:
    inputs = pictures.detach().requires_grad_(True)
    return inputs, critic(inputs)


def _gradient(inputs: Tensor, logits: Tensor) -> Tensor:
    (gradient,) = torch.autograd.grad(logits.sum(), inputs, create_graph=True)
    return gradient
