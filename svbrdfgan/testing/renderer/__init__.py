"""The conformance kit of renderers.

class TestMine(RendererTests):
    name = "mine"
"""

from svbrdfgan.testing.renderer.agreement import AgreementTests
from svbrdfgan.testing.renderer.alpha import AlphaTests
from svbrdfgan.testing.renderer.contract import ContractTests
from svbrdfgan.testing.renderer.deferred import DeferredTests
from svbrdfgan.testing.renderer.extremes import ExtremeTests
from svbrdfgan.testing.renderer.gradients import GradientTests
from svbrdfgan.testing.renderer.layers import LayerTests
from svbrdfgan.testing.renderer.map_gradients import MapGradientTests
from svbrdfgan.testing.renderer.materials import MaterialTests
from svbrdfgan.testing.renderer.normal_maps import NormalMapTests
from svbrdfgan.testing.renderer.orientation import OrientationTests
from svbrdfgan.testing.renderer.radiometry import RadiometryTests
from svbrdfgan.testing.renderer.randomness import RandomnessTests
from svbrdfgan.testing.renderer.resources import ResourceTests
from svbrdfgan.testing.renderer.shapes import ShapeTests
from svbrdfgan.testing.renderer.side_effects import SideEffectTests
from svbrdfgan.testing.renderer.sizes import SizeTests
from svbrdfgan.testing.renderer.stress import StressTests

__all__ = ["RendererTests"]


class RendererTests(
    ContractTests,
    SideEffectTests,
    ShapeTests,
    RadiometryTests,
    MaterialTests,
    NormalMapTests,
    AlphaTests,
    OrientationTests,
    GradientTests,
    LayerTests,
    RandomnessTests,
    AgreementTests,
    MapGradientTests,
    DeferredTests,
    StressTests,
    ResourceTests,
    SizeTests,
    ExtremeTests,
):
    """The duties of every renderer: `svbrdfgan.protocols` and `docs/conventions.md`."""
