"""Stored light: shaded pictures and gradients against quadrature, and that they depend on nothing but what is given."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import torch
from jaxtyping import Float
from numpy import ndarray
from torch import Tensor

from svbrdfgan.rendering.checked_renderer import CheckedLight, checked
from svbrdfgan.testing import scenes
from svbrdfgan.testing.kit import check, declared
from svbrdfgan.testing.renderer import cases, stored_light
from svbrdfgan.testing.renderer.cases import Case
from svbrdfgan.testing.renderer.statistical_assertions import Known, StatisticalKit, exactly
from svbrdfgan.testing.renderer.stored_light import StoredCase, shade_together
from svbrdfgan.testing.statistics import Estimate, block_sums, difference, estimate, margin, numbers
from svbrdfgan.types import CHANNELS

_SPP = 16
_FEW, _ALL = 3, 64
"""Hits kept of `_SPP` camera samples: a share of them, and every one."""
_VISITS = (0, 1, 5, 1000)
_RENEWED = 8
"""Visits after which none of the light samples is as it was."""
_MOST = 8_000_000
_BATCH = 17
_SIGMAS = 5.0
_ATOMICS = 1e-5
"""The relative difference allowed on devices that do not fix the order of additions."""


Summary = Callable[[Float[ndarray, "rows cols channels"]], Float[ndarray, "*shape channels"]]


class DeferredTests(StatisticalKit):
    """`store_light` and `shade`."""

    def test_stored_light_gives_the_picture(self) -> None:
        """Shaded pictures, and those of all other parts, add up to the picture, to 3 % in every block.

        One batch has views with few hits, with all, and with none, of one and of several learnable parts.
        """
        maps = self._all_maps()
        strips, lidded = (stored_light.strips(maps), (0, 1)), (stored_light.lidded(maps), (0,))
        self._require_pictures(strips, lidded, strips)

    def test_stored_light_behind_clear_parts_gives_the_picture(self) -> None:
        """Camera samples and light pass by alpha, to 3 % in every block."""
        maps = self._all_maps()
        declared(self.capabilities.alpha, "alpha")
        clear = stored_light.clear(maps), (0, 1)
        self._require_pictures(clear, clear)

    def test_gradients_of_stored_light(self) -> None:
        """Every texel's gradient of every map is as quadrature says, to 8 % of the largest of the map."""
        self._require_gradients(lambda gradient: gradient, claim=0.08, spp=64)

    def test_gradients_of_stored_light_in_total(self) -> None:
        """The sum of each map's gradient over all texels is as quadrature says, to 1 %."""
        self._require_gradients(lambda gradient: gradient.sum(axis=(0, 1)), claim=0.01, spp=512)

    def test_a_pullback_of_stored_light_is_of_its_picture(self) -> None:
        """In the base colour pictures are linear, and move exactly as the pullback says, whatever was shaded since."""
        stored = StoredCase(self.renderer, stored_light.strips(self._all_maps()), (0, 1))
        lights = [stored.store(hits=hits, spp=_SPP, seed=seed) for seed, hits in enumerate((_FEW, _ALL))]
        textures, rng = stored.textures.repeat(2, 1, 1, 1), torch.Generator().manual_seed(0)
        images, pullback = stored.shade(*lights, textures=textures, visit=2, seed=3)
        grad = torch.randn(images.shape, generator=rng)
        steps = torch.zeros(4, *textures.shape)
        steps[..., :3] = torch.randn(steps[..., :3].shape, generator=rng)
        moved = [stored.shade(*lights, textures=textures + step, visit=2, seed=3)[0] - images for step in steps]
        wanted = np.array([(numbers(each) * numbers(grad)).sum() for each in moved])
        for what in ("at once", "for a second time"):
            slopes = numbers(pullback(grad)) * numbers(steps)
            exactly(f"the change of the picture by the gradient, asked for {what},", slopes.sum((1, 2, 3, 4)), wanted)
        stored.shade(*lights, visit=7, seed=4)
        slopes = numbers(pullback(grad)) * numbers(steps)
        exactly("the change by the gradient, asked for after a later visit,", slopes.sum((1, 2, 3, 4)), wanted)

    def test_large_batches_of_stored_light(self) -> None:
        """Of 17 views in a batch each is as bright as alone, has its own texture, and its own gradient."""
        self._declared_deferred()
        case = stored_light.uniform(cases.soft_light())
        stored = StoredCase(self.renderer, case, (0,))
        lights = [stored.store(hits=4, spp=4, seed=seed) for seed in range(_BATCH)]
        colors = scenes.random_texture(1, _BATCH)[0].reshape(_BATCH, 1, 1, 3)
        images, pullback = stored.shade(*lights, textures=colors, seed=1)
        grad = torch.randn(images.shape, generator=torch.Generator().manual_seed(0))
        found = numbers(pullback(grad)).reshape(_BATCH, 3)
        wanted = (numbers(images) * numbers(grad)).sum(axis=(1, 2)) / numbers(colors).reshape(_BATCH, 3)
        exactly("the gradient of each view of a large batch", found, wanted)
        alone = [stored.shade(light, textures=colors[:1], seed=seed)[0] for seed, light in enumerate(lights)]
        pixels = [numbers(each).reshape(_BATCH, -1, 3) for each in (images, torch.cat(alone))]
        together, apart = (estimate(list(p.transpose(1, 0, 2))) for p in pixels)
        tint = numbers(colors / colors[:1]).reshape(_BATCH, 3)
        scaled = Estimate(apart.mean * tint, apart.error * tint, apart.freedom)
        off = difference(together, scaled)
        worst = int((abs(off.mean) / margin(off)).max(axis=1).argmax())
        message = f"View {worst} of {_BATCH} is {together.mean[worst]} in a batch, {scaled.mean[worst]} alone"
        check(bool((abs(off.mean) <= margin(off)).all()), f"{message}; wanted the same within {margin(off)[worst]}.")

    def test_stored_light_depends_on_the_visit_alone(self) -> None:
        """Whichever visits came before, a visit's picture is that of light stored anew."""
        stored = StoredCase(self.renderer, stored_light.lidded(self._all_maps()), (0,))

        def fresh() -> CheckedLight:
            return stored.store(hits=6, spp=_SPP, seed=3)

        visited = fresh()
        for visit in (0, 1, 2, 3, 4, 5, 9, 1000, 1001, 2):
            found, wanted = (stored.shade(light, visit=visit, seed=5)[0] for light in (visited, fresh()))
            off, slack = float((found - wanted).abs().max()), self._atomics * float(wanted.abs().max())
            check(off <= slack, f"visit {visit} after others differs by {off:.3g} from the same visit of fresh light.")

    def test_stored_light_is_renewed(self) -> None:
        """The noise of a visit says nothing about that of the eighth one after it.

        Under a sun it is all in the stored light samples.
        """
        self._declared_deferred()
        stored = StoredCase(self.renderer, stored_light.uniform(scenes.sun(30, 5, rotation=0.4)), (0,))
        lights = [stored.store(hits=4, spp=4, seed=seed) for seed in range(8)]
        visits = range(0, 4 * _RENEWED, _RENEWED)
        pictures = [numbers(stored.shade(*lights, visit=visit, seed=100 + visit)[0]) for visit in visits]
        self._require_independent("visits eight apart", np.stack(pictures))

    def test_views_of_a_batch_have_their_own_noise(self) -> None:
        """Each view of a batch has random numbers of its own for what is drawn anew."""
        self._declared_deferred()
        stored = StoredCase(self.renderer, stored_light.uniform(cases.side_light()), (0,))
        lights = [stored.store(hits=4, spp=4, seed=seed) for seed in range(4)]
        pictures = [numbers(stored.shade(*lights, visit=_RENEWED * seed, seed=seed)[0]) for seed in range(8)]
        self._require_independent("the views of a batch", np.stack(pictures, axis=1))

    def test_shading_depends_on_its_arguments_alone(self) -> None:
        """The same arguments give the same picture, another seed another one, and later writes change nothing."""
        case = stored_light.strips(self._all_maps())
        stored = StoredCase(self.renderer, case, (0, 1))
        light, textures = stored.store(hits=_FEW, spp=_SPP, seed=1), stored.textures.to(self.renderer.device)
        image, pullback = stored.shade(light, textures=textures.clone(), visit=3, seed=2)
        grad = torch.randn(image.shape, generator=torch.Generator().manual_seed(0)).to(image.device)
        wanted = pullback(grad)
        again = StoredCase(checked(self.make_renderer()), case, (0, 1))
        same = again.shade(again.store(hits=_FEW, spp=_SPP, seed=1), textures=textures.clone(), visit=3, seed=2)[0]
        self._require_same("the picture, by a second renderer,", same, image)
        other = stored.shade(light, visit=3, seed=2**40)[0]
        check(not torch.equal(other, image), "two seeds give the same picture.")
        _, pullback = stored.shade(light, textures=textures, visit=3, seed=2)
        for values in (textures, case.view.environment.radiance):
            values.fill_(0.9)
        self._require_same("the gradient, after textures and light were written into,", pullback(grad), wanted)
        same = stored.shade(light, textures=again.textures, visit=3, seed=2)[0]
        self._require_same("the picture, after the light was written into,", same, image)

    def test_shaded_pictures_are_shaped_as_the_film(self) -> None:
        """Pictures and gradients are float32 on the renderer's device; of unseen parts they are zero."""
        stored = StoredCase(self.renderer, stored_light.strips(self._all_maps()), (1,))
        unseen = replace(stored, case=stored_light.away(stored.case))
        lights = [each.store(hits=_FEW, spp=_SPP, seed=0) for each in (unseen, stored, unseen)]
        images, pullback = stored.shade(*lights)
        gradient = pullback(torch.ones(images.shape))
        for what, values, shape in (
            ("the pictures are", images, (3, 4, 4, 3)),
            ("the gradient is", gradient, (3, *stored.textures.shape[1:])),
        ):
            found = tuple(values.shape), values.dtype, values.device.type
            wanted = shape, torch.float32, self.renderer.device.type
            check(found == wanted, f"{what} {found}; wanted {wanted}.")
            check(not values[[0, 2]].any() and bool(values[1].any()), f"{what} not zero where nothing is seen.")
        dark, pullback = unseen.shade(lights[0])
        check(not dark.any() and not pullback(dark).any(), "a view of nothing, by itself, is not black.")
        check(lights[1].nbytes > 0, f"nbytes of a view is {lights[1].nbytes}.")

    def _require_pictures(self, *views: tuple[Case, tuple[int, ...]]) -> None:
        """Fails unless these views are right; by turns few hits of each pixel are kept, and all."""
        stored = [StoredCase(self.renderer, case, learnable) for case, learnable in views]
        known = _joined(
            [self.known(case, lambda scene: block_sums(scene.image(), 2), grid=8, split=8) for case, _ in views]
        )

        def measure(spp: int, seed: int) -> Float[ndarray, "views rows cols 3"]:
            visit, kept = _VISITS[seed % len(_VISITS)], [max(1, spp // 4), 2 * spp]
            lights = [each.store(hits=kept[n % 2], spp=spp, seed=seed) for n, each in enumerate(stored)]
            images = shade_together(stored, lights, visit=visit, seed=seed)
            beside = [each.beside(spp=spp, seed=seed) for each in stored]
            return np.stack([block_sums(image + rest, 2) for image, rest in zip(images, beside, strict=True)])

        self.unbiased("image by stored light, by blocks", stored[0].rendered, measure, known, claim=0.03, spp=_SPP)

    def _require_gradients(self, summary: Summary, *, claim: float, spp: int) -> None:
        maps = self._all_maps()
        case = stored_light.sheet(maps)
        stored, grad = StoredCase(self.renderer, case, (0,)), case.smooth()
        truths = [self._known_gradient(case, grad, name, summary) for name in maps]
        known, largest = _joined([each for each, _ in truths], axis=-1), np.concatenate([size for _, size in truths])

        def measure(spp: int, seed: int) -> Float[ndarray, "*shape channels"]:
            light = stored.store(hits=2 * spp, spp=spp, seed=seed)
            _, pullback = stored.shade(light, visit=_VISITS[seed % len(_VISITS)], seed=seed)
            return summary(numbers(pullback(torch.from_numpy(grad).float()[None]))[0]) / largest

        self.unbiased("gradient", stored.rendered, measure, known, claim=claim, spp=spp, most=_MOST)

    def _known_gradient(
        self, case: Case, grad: ndarray, name: str, summary: Summary
    ) -> tuple[Known, Float[ndarray, " channels"]]:
        """The gradient of one map in units of its largest value, and that value for each channel."""
        known = self.known(case, lambda scene: summary(scene.map_gradients(name, (grad,), 0)[0]), split=16)
        largest = known.size.max()
        one = np.ones_like(known.size)
        return Known(known.truth / largest, known.doubt / largest, one), np.full(CHANNELS[name], largest)

    def _require_independent(self, what: str, pictures: Float[ndarray, "kinds runs height width 3"]) -> None:
        """Fails if the noise of pictures goes with that of others in the same run and pixel."""
        noise = (pictures - pictures.mean()).mean(axis=-1)
        noise = noise / noise.std()
        products = [(a * b).ravel() for n, a in enumerate(noise) for b in noise[:n]]
        found, error = float(np.mean(products)), 1.0 / math.sqrt(np.size(products))
        message = f"Noise of {what} correlates by {found:.3f}; wanted 0 within {_SIGMAS * error:.3f}"
        check(abs(found) <= _SIGMAS * error, f"{message}: do they share light samples or rays?")

    def _require_same(self, what: str, found: Tensor, wanted: Tensor) -> None:
        off, slack = float((found - wanted).abs().max()), self._atomics * float(wanted.abs().max())
        check(off <= slack, f"{what} differs by up to {off:.3g}; wanted at most {slack:.3g}.")

    @property
    def _atomics(self) -> float:
        return 0.0 if self.renderer.device.type == "cpu" else _ATOMICS

    def _all_maps(self) -> tuple[str, ...]:
        """All that it reads, in the order of `shade`."""
        self._declared_deferred()
        return tuple(name for name in CHANNELS if name in self.capabilities.maps)

    def _declared_deferred(self) -> None:
        declared(self.capabilities.deferred, "stored light")


def _joined(known: Sequence[Known], axis: int | None = None) -> Known:
    """Several known values as one array: stacked, or one after the other along an axis."""

    def join(arrays: Sequence[ndarray]) -> ndarray:
        return np.stack(arrays) if axis is None else np.concatenate(arrays, axis=axis)

    fields = ((each.truth, each.doubt, each.size) for each in known)
    return Known(*(join(arrays) for arrays in zip(*fields, strict=True)))
