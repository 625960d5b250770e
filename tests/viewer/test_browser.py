"""The viewer in a real browser: Chromium without a window, whose WebGL is SwiftShader."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from click.testing import CliRunner
from jaxtyping import Float
from numpy import ndarray
from PIL import Image

from svbrdfgan.cli import main
from svbrdfgan.utils.display import SilentDisplay
from svbrdfgan.viewer.exhibit import Exhibit
from svbrdfgan.viewer.page import write_page
from svbrdfgan.viewer.server import serve

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

pytestmark = pytest.mark.full

_FLAGS = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist"]
_PATIENCE = 120_000  # milliseconds


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    program = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    if program is None:
        if "chromium" in os.environ.get("SVBRDFGAN_REQUIRED_TOOLS", "").split():
            pytest.fail("SVBRDFGAN_REQUIRED_TOOLS names chromium, which is not installed")
        pytest.skip("Chromium is not installed")
    from playwright.sync_api import sync_playwright

    with sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=program, args=_FLAGS)
        yield browser
        browser.close()


@pytest.fixture(scope="module")
def dust_address(dusty: Exhibit, van: Path) -> Iterator[str]:
    """A live page of the van under dust alone."""
    live = Exhibit(dusty.title, dusty.pieces, dusty.lights, dusty.fine)
    with serve(live) as address:
        yield address


class Watched:
    """A page that must not complain."""

    def __init__(self, browser: Browser, width: int = 1000, height: int = 700, scheme: str = "light") -> None:
        context = browser.new_context(
            viewport={"width": width, "height": height},
            color_scheme=scheme,  # type: ignore[arg-type]
        )
        self.page: Page = context.new_page()
        self.complaints: list[str] = []
        self.page.on("pageerror", lambda error: self.complaints.append(str(error)))
        self.page.on(
            "console", lambda said: self.complaints.append(said.text) if said.type in ("error", "warning") else None
        )

    def open(self, address: str) -> Watched:
        self.page.goto(address)
        self.painted("/layer/0/0/")
        return self

    def painted(self, part: str) -> None:
        """Waits until a layer whose path has this part is shown."""
        self.page.wait_for_selector(f'canvas[data-painted*="{part}"]', timeout=_PATIENCE)

    def shown(self) -> Float[ndarray, "height width 3"]:
        """What the canvas shows, in [0, 255]."""
        self.page.wait_for_timeout(1500)
        picture = Image.open(BytesIO(self.page.locator("#view").screenshot())).convert("RGB")
        return np.asarray(picture).astype(np.float64)[:-60]  # below is the status

    def calm(self) -> None:
        assert [text for text in self.complaints if "GPU stall" not in text and "Automatic fallback" not in text] == []


def difference(a: Float[ndarray, "height width 3"], b: Float[ndarray, "height width 3"]) -> float:
    """Mean over the pixels of the greatest difference of a channel."""
    return float(np.abs(a - b).max(axis=-1).mean())


def test_a_car_is_shown_and_sliders_repaint_it(browser: Browser, dust_address: str) -> None:
    watched = Watched(browser).open(dust_address)
    dirty = watched.shown()
    assert dirty.std(axis=(0, 1)).min() > 12.0, "the picture is one colour"
    watched.page.locator("#amount").fill("100")
    watched.painted("/100/")
    dirtier = watched.shown()
    assert difference(dirty, dirtier) > 0.5
    watched.page.get_by_text("Clean", exact=True).click()
    clean = watched.shown()
    assert difference(clean, dirtier) > difference(dirty, dirtier) > 0.5
    watched.page.get_by_text("Weathered", exact=True).click()
    watched.page.locator("#use-color").uncheck()
    watched.page.locator("#use-gloss").uncheck()
    watched.page.locator("#use-relief").uncheck()
    assert difference(watched.shown(), clean) < 0.2
    watched.calm()


def test_seed_look_and_light_change_the_picture(browser: Browser, dust_address: str) -> None:
    watched = Watched(browser).open(dust_address)
    first = watched.shown()
    watched.page.locator("#dice").click()
    watched.painted("/layer/0/0/1/")
    other = watched.shown()
    assert difference(first, other) > 0.1
    watched.page.locator("#look").select_option("5")
    where = watched.shown()
    assert difference(other, where) > 3.0
    watched.page.locator("#look").select_option("0")
    watched.page.locator("#light").select_option("1")
    assert difference(other, watched.shown()) > 1.0
    watched.page.locator("#light").select_option("0")
    watched.page.locator("#turn").fill("120")
    assert difference(other, watched.shown()) > 0.5
    watched.calm()


def test_a_page_works_offline_from_its_file(browser: Browser, dusty: Exhibit, tmp_path: Path) -> None:
    write_page(tmp_path / "van.html", dusty, SilentDisplay())
    watched = Watched(browser)
    watched.page.context.set_offline(True)
    watched.open(f"file://{tmp_path / 'van.html'}")
    half = watched.shown()
    assert half.std(axis=(0, 1)).min() > 12.0, "the picture is one colour"
    watched.page.locator("#amount").fill("1")
    watched.painted("/layer/0/0/0/100/")
    assert difference(half, watched.shown()) > 0.5
    watched.calm()


def test_a_report_contains_a_vehicle_to_turn_about(browser: Browser, varied_run: Path, tmp_path: Path) -> None:
    run = shutil.copytree(varied_run, tmp_path / "run")
    result = CliRunner().invoke(
        main, ["evaluate", str(run), "--split", "validation", "--no-oracle", "--device", "cpu", "--view"]
    )
    assert result.exit_code == 0, result.output
    watched = Watched(browser)
    watched.page.context.set_offline(True)
    watched.page.goto(f"file://{run / 'report.validation.html'}")
    live = watched.page.frame_locator("iframe.live").locator('#view[data-painted*="/layer/0/0/"]')
    live.scroll_into_view_if_needed(timeout=_PATIENCE)
    watched.page.wait_for_timeout(1500)
    picture = np.asarray(Image.open(BytesIO(live.screenshot())).convert("RGB")).astype(np.float64)
    assert picture.std(axis=(0, 1)).min() > 12.0, "the picture is one colour"
    watched.calm()


@pytest.mark.parametrize(("width", "height"), [(1440, 900), (390, 844)])
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_the_page_fits_any_screen(browser: Browser, dust_address: str, width: int, height: int, scheme: str) -> None:
    watched = Watched(browser, width, height, scheme).open(dust_address)
    box = watched.page.locator("#view").bounding_box()
    assert box is not None
    assert box["width"] >= min(width, 390) * 0.99
    assert box["height"] >= 0.4 * height
    body = watched.page.locator("body").bounding_box()
    assert body is not None
    assert body["width"] <= width
    ground = watched.page.locator("body").evaluate("body => getComputedStyle(body).backgroundColor")
    brightness = np.mean([int(part) for part in ground.strip("rgb()").split(",")])
    assert (brightness < 100) == (scheme == "dark")
    watched.calm()


def test_a_wrong_address_says_so(browser: Browser, dust_address: str) -> None:
    watched = Watched(browser)
    watched.page.goto(dust_address.partition("token=")[0] + "token=wrong")
    assert "lacks the token" in watched.page.inner_text("body")
