"""Does a page work in a real browser: on a phone, in the dark, on paper, without a request?

These tests need Chromium and its driver (Debian: apt-get install chromium chromium-driver) and
selenium; without them they are skipped.
"""

from __future__ import annotations

import json
import shutil
from base64 import b64decode
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from bulgefit.report.page.page import page_html
from bulgefit.report.record import record_of

pytest.importorskip("selenium", reason="pages are opened by selenium, which is not installed")

from selenium import webdriver
from selenium.webdriver.chrome.service import Service
from selenium.webdriver.common.action_chains import ActionChains
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys

CHROMIUM = shutil.which("chromium") or shutil.which("google-chrome")
DRIVER = shutil.which("chromedriver")

pytestmark = pytest.mark.skipif(
    CHROMIUM is None or DRIVER is None,
    reason="no Chromium with its driver here (apt-get install chromium chromium-driver)",
)

PHONE, DESK = 390, 1280
#: The name of a file that would be a script.
NAME = '<script>document.title = "broken in"</script><b>plate'

_FLAGS = (
    "--headless", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage", "--disable-quic",
    "--no-first-run", "--disable-background-networking", "--disable-component-update",
    "--disable-sync",
)  # fmt: skip


@contextmanager
def opened(profile: Any) -> Iterator[webdriver.Chrome]:
    options = webdriver.ChromeOptions()
    options.binary_location = CHROMIUM or ""
    for flag in (*_FLAGS, f"--user-data-dir={profile}"):
        options.add_argument(flag)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
    driver = webdriver.Chrome(options=options, service=Service(DRIVER))
    try:
        driver.get("about:blank")  # what the browser's own first page asks for is none of ours
        yield driver
    finally:
        driver.quit()


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    with opened(tmp_path_factory.mktemp("profile")) as driver:
        yield driver


@pytest.fixture(scope="module")
def pages(found, fitted, plate, plain, tmp_path_factory):
    """Files of a diagnosis's page, of two tests for the choice between them, and of a fit's."""
    folder = tmp_path_factory.mktemp("pages")
    record = json.loads(json.dumps(record_of(found)))
    told = record["report"]
    made = {**told["tests"][0], "sha256": "f0" * 32}
    told["tests"] = [{**made, "name": name} for name in (NAME, "second")]
    for key in ("noise",):
        record[key] = 2 * record[key]
    for key in ("mesh", "offsets"):
        told[key] = 2 * told[key]
    for key in ("cells", "modes"):
        told[key] = {kind: 2 * parts for kind, parts in told[key].items()}
    texts = {
        "gap": page_html(record, [replace(plate, name=NAME), replace(plate, name="second")]),
        "fit": page_html(fitted, [plain]),
        "bare": page_html(record, [None, None], notes=["no maps"]),
        "oval": page_html(fitted, [oval(plain)]),
    }
    for name, text in texts.items():
        (folder / f"{name}.html").write_text(text, encoding="utf-8")
    return {name: folder / f"{name}.html" for name in texts}


def oval(test):
    """The same in a clamp of 100 by 60 mm."""
    inside = np.linalg.norm(test.blocks[0].reference[:, :2] / (100.0, 60.0), axis=1) < 0.95
    return replace(test.select(points=inside), radius=80.0, ellipticity=0.25)


def show(browser, page, width=DESK, scheme="light", media=""):
    for log in ("browser", "performance"):
        browser.get_log(log)
    browser.execute_cdp_cmd(
        "Emulation.setEmulatedMedia",
        {"media": media, "features": [{"name": "prefers-color-scheme", "value": scheme}]},
    )
    browser.execute_cdp_cmd(
        "Emulation.setDeviceMetricsOverride",
        {"width": width, "height": 800, "deviceScaleFactor": 1, "mobile": False},
    )
    browser.get(page.as_uri())


def pixels(browser, selector):
    """Of a canvas, as PNG."""
    script = "return document.querySelector(arguments[0]).toDataURL()"
    return b64decode(browser.execute_script(script, selector).partition(",")[2])


def colour_of_paper(browser):
    return browser.execute_script("return getComputedStyle(document.body).backgroundColor")


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("width", [PHONE, DESK])
@pytest.mark.parametrize("name", ["gap", "fit", "bare"])
def test_nothing_is_cut_off_said_or_asked_for(browser, pages, name, width, scheme):
    show(browser, pages[name], width, scheme)
    assert browser.execute_script("return window.innerWidth") == width
    script = "const e = document.documentElement; return [e.scrollWidth, e.clientWidth]"
    whole, seen = browser.execute_script(script)
    assert whole <= seen
    wide = browser.execute_script(
        "return [...document.querySelectorAll('table, .bar, .span, canvas, figure')]"
        ".filter(e => e.getBoundingClientRect().right > document.documentElement.clientWidth + 0.5)"
        ".map(e => e.textContent.slice(0, 40))"
    )
    assert wide == []
    assert browser.execute_script(
        "return [...document.querySelectorAll('.scroll')]"
        ".filter(e => e.scrollWidth > e.clientWidth).map(e => e.textContent.slice(0, 40))"
    ) == []  # fmt: skip
    assert (colour_of_paper(browser) == "rgb(255, 255, 255)") == (scheme == "light")
    assert browser.get_log("browser") == []
    events = [json.loads(e["message"])["message"] for e in browser.get_log("performance")]
    asked = [e["params"]["request"]["url"] for e in events
             if e["method"] == "Network.requestWillBeSent"]  # fmt: skip
    assert [url for url in asked if not url.startswith("data:")] == [pages[name].as_uri()]


def test_the_slider_goes_through_the_pressures(browser, pages):
    show(browser, pages["gap"])
    slider = browser.find_element(By.ID, "pressure")
    bar = browser.find_element(By.ID, "bar")
    assert bar.text == "2.5 bar"
    before = [pixels(browser, f"canvas[data-component='{c}']") for c in range(3)]
    profile = pixels(browser, "canvas[data-along='0']")
    slider.send_keys(Keys.HOME)
    assert bar.text == "0.1 bar"
    canvas = browser.find_element(By.CSS_SELECTOR, "#maps canvas")
    assert canvas.get_attribute("data-frame") == "0"
    after = [pixels(browser, f"canvas[data-component='{c}']") for c in range(3)]
    assert all(a != b for a, b in zip(before, after, strict=True))
    assert pixels(browser, "canvas[data-along='0']") != profile
    slider.send_keys(Keys.END)
    assert [pixels(browser, f"canvas[data-component='{c}']") for c in range(3)] == before


def test_maps_are_coloured_by_what_is_left(browser, pages):
    """Where the camera moved by 0.15 mm along x, dx is orange all over before, and noise after."""
    show(browser, pages["gap"])
    browser.execute_script(
        "const s = document.getElementById('field'); s.value = 'left:0';"
        "s.dispatchEvent(new Event('change'))"
    )
    count = """
      const c = document.querySelector("#maps canvas"), w = c.width, h = c.height;
      const d = c.getContext("2d").getImageData(0, 0.1 * h, w, 0.6 * h).data;
      let warm = 0, cold = 0;
      for (let i = 0; i < d.length; i += 4) {
        if (d[i + 3] < 255) continue;
        if (d[i] > d[i + 2] + 30) warm++;
        if (d[i + 2] > d[i] + 30) cold++;
      }
      return [warm, cold];
    """
    warm, cold = browser.execute_script(count)
    assert warm > 50 * max(cold, 1)
    browser.execute_script(
        "const s = document.getElementById('field'); s.value = 'left:1';"
        "s.dispatchEvent(new Event('change'))"
    )
    warm, cold = browser.execute_script(count)
    assert 0.5 < warm / cold < 2.0


def test_the_surface_turns_and_takes_its_colour_from_any_field(browser, pages):
    show(browser, pages["gap"])
    canvas = browser.find_element(By.ID, "surface")
    seen = {pixels(browser, "#surface")}
    turn = canvas.get_attribute("data-turn")
    ActionChains(browser).move_to_element(canvas).click_and_hold().move_by_offset(
        80, 30
    ).release().perform()
    assert canvas.get_attribute("data-turn") != turn
    seen.add(pixels(browser, "#surface"))
    tilt = float(canvas.get_attribute("data-tilt"))
    canvas.send_keys(Keys.ARROW_DOWN)
    assert float(canvas.get_attribute("data-tilt")) == pytest.approx(tilt - 0.1, abs=2e-3)
    seen.add(pixels(browser, "#surface"))
    options = browser.find_elements(By.CSS_SELECTOR, "#colour option")
    assert len(options) == 15  # dx, dy, dz of what is measured, and modelled and left twice
    for option in options[1::4]:
        option.click()
        seen.add(pixels(browser, "#surface"))
    assert len(seen) == 3 + len(options[1::4])


def test_an_elliptic_clamp_is_an_ellipse(browser, pages):
    """What is painted of a map reaches as far as the clamp does along x and y, and no farther."""
    show(browser, pages["oval"])
    left, right, top, bottom = browser.execute_script("""
      const c = document.querySelector("#maps canvas"), [w, h] = [c.width, c.height];
      const [first, last] = [Math.round(0.1 * h), Math.round(0.78 * h)];
      const d = c.getContext("2d").getImageData(0, first, w, last - first).data;
      let [left, right, top, bottom] = [w, 0, h, 0];
      for (let y = 0; y < last - first; y++) for (let x = 0; x < w; x++) {
        if (!d[4 * (y * w + x) + 3]) continue;
        [left, right] = [Math.min(left, x), Math.max(right, x)];
        [top, bottom] = [Math.min(top, y), Math.max(bottom, y)];
      }
      return [left, right, top, bottom];
    """)
    assert (bottom - top) / (right - left) == pytest.approx(0.6, abs=0.02)


def luminance(colour):
    """Of `rgb(r, g, b)`, relative (WCAG 2.1)."""
    parts = np.array([int(part) for part in colour[4:-1].split(",")]) / 255
    linear = np.where(parts <= 0.04045, parts / 12.92, ((parts + 0.055) / 1.055) ** 2.4)
    return linear @ (0.2126, 0.7152, 0.0722)


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_numbers_stand_out_from_every_colour(browser, pages, scheme):
    """By the contrast that WCAG 2.1 asks of text, 4.5."""
    show(browser, pages["gap"], scheme=scheme)
    pairs = browser.execute_script("""
      const svg = document.querySelector(".discs svg"), out = [];
      for (const sign of "np") for (const level of [1, 2, 3, 4]) {
        const [field, text] = ["path", "text"].map((name) =>
          svg.appendChild(document.createElementNS("http://www.w3.org/2000/svg", name)));
        field.setAttribute("class", `w ${sign}${level}`);
        text.setAttribute("class", `on${level}`);
        out.push([getComputedStyle(field).fill, getComputedStyle(text).fill]);
      }
      return out;
    """)
    for field, text in pairs:
        low, high = sorted([luminance(field), luminance(text)])
        assert (high + 0.05) / (low + 0.05) >= 4.5


def test_another_test_is_chosen(browser, pages):
    show(browser, pages["gap"], PHONE)
    names = [o.text for o in browser.find_elements(By.CSS_SELECTOR, "#test option")]
    assert names == [NAME, "second"]
    browser.find_element(By.ID, "pressure").send_keys(Keys.HOME)
    browser.find_elements(By.CSS_SELECTOR, "#test option")[1].click()
    assert browser.find_element(By.ID, "bar").text == "2.5 bar"


def shown(browser):
    """Of each fold whether it is open, and whether what it holds is seen."""
    return browser.execute_async_script("""
      const done = arguments[0], look = {contentVisibilityAuto: true, visibilityProperty: true};
      // once it is drawn
      requestAnimationFrame(() => requestAnimationFrame(() => done(
        [...document.querySelectorAll("details")].map((fold) =>
          [fold.open, fold.querySelector("table, .bars, .discs").checkVisibility(look)]))));
    """)


@pytest.mark.parametrize("width", [PHONE, DESK])
def test_each_of_several_tests_is_folded_away(browser, pages, width):
    """A test more takes a line or two of the page, and none of its length."""
    show(browser, pages["bare"], width)
    folds = browser.find_elements(By.TAG_NAME, "details")
    names = [fold.find_element(By.TAG_NAME, "h3").text for fold in folds]
    assert names == [
        "all specimens", "the same on the fitted data", NAME, "second", "all of them",
    ]  # fmt: skip
    assert max(f.size["height"] for f in folds) < 120
    shut, opened = [False, False], [True, True]
    assert shown(browser) == [shut] * 5
    folds[3].find_element(By.TAG_NAME, "summary").click()
    assert shown(browser) == [shut, shut, shut, opened, shut]
    assert folds[3].size["height"] > 800
    # paper has everything, be it by the page's script or its style
    browser.execute_script("dispatchEvent(new Event('beforeprint'))")
    assert shown(browser) == [opened] * 5
    browser.execute_script("dispatchEvent(new Event('afterprint'))")
    assert shown(browser) == [shut, shut, shut, opened, shut]
    show(browser, pages["bare"], width, media="print")
    assert shown(browser) == [[False, True]] * 5


def test_folds_open_without_scripts(browser, pages):
    browser.execute_cdp_cmd("Emulation.setScriptExecutionDisabled", {"value": True})
    try:
        show(browser, pages["bare"], PHONE)
        fold = browser.find_element(By.TAG_NAME, "details")
        fold.find_element(By.TAG_NAME, "summary").click()
        assert fold.get_attribute("open")
        assert fold.find_element(By.TAG_NAME, "table").is_displayed()
    finally:
        browser.execute_cdp_cmd("Emulation.setScriptExecutionDisabled", {"value": False})


def test_a_name_is_no_script(browser, pages):
    show(browser, pages["gap"])
    assert browser.title == f"What separates the model from {NAME} and second"
    heading = browser.find_element(By.TAG_NAME, "h1")
    assert NAME in heading.text
    assert heading.find_elements(By.XPATH, ".//*") == []


def test_on_paper_it_is_light_and_has_no_controls(browser, pages):
    show(browser, pages["gap"], scheme="dark", media="print")
    assert colour_of_paper(browser) == "rgb(255, 255, 255)"
    assert not browser.find_element(By.ID, "field").is_displayed()
    ink = browser.execute_script(
        "return getComputedStyle(document.documentElement).getPropertyValue('--ink').trim()"
    )
    assert ink == "#000"
    printed = browser.execute_cdp_cmd("Page.printToPDF", {"printBackground": True})
    assert b64decode(printed["data"]).startswith(b"%PDF")
