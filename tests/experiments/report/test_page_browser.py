"""The report's page in Chromium. Skipped without Playwright or without a Chromium."""

import itertools

import pytest

from jotlight.experiments.report.page import render_page
from reference.reports import realistic_report

pytestmark = pytest.mark.slow

DESKTOP = {"width": 1280, "height": 900}


@pytest.fixture(scope="module")
def address(tmp_path_factory):
    path = tmp_path_factory.mktemp("report") / "report.html"
    path.write_text(render_page(realistic_report()), "utf-8")
    return path.as_uri()


@pytest.fixture
def opened(browser, address):
    """Open the page. At the end, no error was logged and nothing was fetched."""
    pages, errors, requests = [], [], []

    def opened(**options):
        tab = browser.new_page(**({"viewport": DESKTOP} | options))
        tab.on("console", lambda message: errors.append(message.text))
        tab.on("pageerror", lambda error: errors.append(str(error)))
        tab.on("request", lambda request: requests.append(request.url))
        tab.goto(address)
        pages.append(tab)
        return tab

    yield opened
    for tab in pages:
        tab.close()
    assert errors == []
    assert all(url.startswith(("file:", "data:")) for url in requests)


def column(table, number):
    return table.locator(f"tbody tr > :nth-child({number})").all_inner_texts()


def direction(table, number):
    return table.locator("thead th").nth(number - 1).get_attribute("aria-sort")


def test_a_click_and_the_keyboard_sort_tables(opened):
    tab = opened()
    table = tab.locator("table.sortable").first
    heading = table.get_by_role("button", name="Time, ms")
    before = column(table, 4)
    assert direction(table, 4) is None
    heading.click()
    assert column(table, 4) == ["0.8", "4.2", "11.9", "212.0", "655.3"]
    assert direction(table, 4) == "ascending"
    heading.press("Enter")
    assert column(table, 4) == ["655.3", "212.0", "11.9", "4.2", "0.8"]
    assert direction(table, 4) == "descending"
    heading.press("Space")
    assert column(table, 4) == before
    assert direction(table, 4) is None


def test_missing_cells_stay_last_equal_cells_keep_their_order_and_text_sorts_as_text(opened):
    tab = opened()
    table = tab.locator("table.sortable").first
    table.get_by_role("button", name="Steps").click()
    assert column(table, 5) == ["100", "214", "–", "–", "–"]
    assert column(table, 1)[2:] == ["maximum likelihood", "non-iterative, Gaussian", "network"]
    table.get_by_role("button", name="Steps").click()
    assert column(table, 5) == ["214", "100", "–", "–", "–"]
    table.get_by_role("button", name="Method").click()
    assert direction(table, 5) is None
    assert column(table, 1)[0] == "ADMM, total variation"
    table.get_by_role("button", name="Source").click()
    assert column(table, 6) == ["Chan 2014", "paper, (7)", "paper, (12)", "paper, (21)", "–"]


def test_a_long_table_opens_and_sorts(opened):
    tab = opened()
    details = tab.locator("details.table")
    table = details.locator("table")
    assert not table.is_visible()
    details.locator("summary").click()
    assert table.locator("tbody tr").count() == 100
    assert table.is_visible()
    table.get_by_role("button", name="Image").click()
    table.get_by_role("button", name="Image").click()
    assert column(table, 1)[:2] == ["image 100", "image 99"]


def clip(scene):
    return scene.locator(".stage img.left").evaluate("it => getComputedStyle(it).clipPath")


def left_share(scene):
    stage = scene.locator(".stage").bounding_box()
    line = scene.locator(".line").bounding_box()
    return (line["x"] + line["width"] / 2 - stage["x"]) / stage["width"]


def test_the_slider_follows_the_keyboard_and_the_mouse(opened):
    tab = opened()
    scene = tab.locator(".scene").first
    range_input = scene.locator("input[type=range]")
    clips = [clip(scene)]
    assert left_share(scene) == pytest.approx(0.5, abs=0.01)

    range_input.press("ArrowRight")
    clips.append(clip(scene))
    assert left_share(scene) == pytest.approx(0.51, abs=0.005)

    scene.locator(".stage").scroll_into_view_if_needed()
    box = scene.locator(".stage").bounding_box()
    tab.mouse.move(box["x"] + box["width"] * 0.3, box["y"] + 20)
    tab.mouse.down()
    tab.mouse.move(box["x"] + box["width"] * 0.8, box["y"] + 40)
    assert left_share(scene) == pytest.approx(0.8, abs=0.01)
    tab.mouse.move(box["x"] + box["width"] * 2, box["y"] + 40)
    assert left_share(scene) == pytest.approx(1, abs=0.01)
    tab.mouse.move(box["x"] + box["width"] * 0.25, box["y"] + 40)
    tab.mouse.up()
    tab.mouse.move(box["x"] + box["width"] * 0.9, box["y"] + 40)
    assert left_share(scene) == pytest.approx(0.25, abs=0.01)
    assert range_input.input_value() == "25"
    clips.append(clip(scene))
    assert len(set(clips)) == 3


def test_the_slider_follows_a_touch(opened):
    tab = opened(viewport={"width": 375, "height": 700}, has_touch=True)
    scene = tab.locator(".scene").first
    stage = scene.locator(".stage")
    box = stage.bounding_box()
    stage.tap(position={"x": box["width"] * 0.75, "y": 50})
    assert left_share(scene) == pytest.approx(0.75, abs=0.01)


def source(scene, side):
    return scene.locator(f".stage img.{side}").get_attribute("src")


def test_the_menus_change_the_images_and_their_scores(opened):
    tab = opened()
    scene = tab.locator(".scene").first
    crops = [image.get_attribute("src") for image in scene.locator(".crop img").all()]
    assert (source(scene, "left"), source(scene, "right")) == (crops[0], crops[-1])
    assert scene.locator("output.right").inner_text() == "28.71 dB, SSIM 0.803"
    scene.locator("select.left").select_option(label="bits")
    scene.locator("select.right").select_option(label="maximum likelihood")
    assert (source(scene, "left"), source(scene, "right")) == (crops[1], crops[2])
    assert scene.locator("output.left").inner_text() == "4 × 4 jots per pixel"
    assert scene.locator("output.right").inner_text() == "21.34 dB, SSIM 0.418"
    boxes = [scene.locator(f".stage img.{side}").bounding_box() for side in ("left", "right")]
    assert boxes[0] == boxes[1]


def test_a_click_on_an_enlarged_area_shows_its_image_on_the_right(opened):
    tab = opened()
    scene = tab.locator(".scene").nth(1)
    crop = scene.locator(".crop").nth(1)
    crop.locator("button").click()
    assert source(scene, "right") == crop.locator("img").get_attribute("src")
    assert scene.locator("select.right").input_value() == "1"
    pressed = [each.get_attribute("aria-pressed") for each in scene.locator(".crop button").all()]
    assert pressed == ["false", "true", "false", "false"]


def test_enlarged_areas_show_what_the_frame_shows(opened):
    tab = opened()
    scene = tab.locator(".scene").nth(2)
    frame, stage = (scene.locator(name).bounding_box() for name in (".frame", ".stage"))
    crops = scene.locator(".crop").all()
    assert crops
    for crop in crops:
        window, image = (crop.locator(name).bounding_box() for name in (".window", "img"))
        assert crop.locator("img").evaluate("it => it.complete && it.naturalWidth > 0")
        for axis, length in (("x", "width"), ("y", "height")):
            shown = (window[axis] - image[axis]) / image[length], window[length] / image[length]
            framed = (frame[axis] - stage[axis]) / stage[length], frame[length] / stage[length]
            assert shown == pytest.approx(framed, abs=0.01)


def test_images_fit_on_the_screen(opened):
    tab = opened(viewport={"width": 1280, "height": 700})
    shown = tab.locator(".compare").all()
    assert shown
    for compare in shown:
        assert compare.bounding_box()["height"] <= 700
        assert compare.bounding_box()["width"] <= 1280


CONTRASTS = """
() => {
  // A canvas converts any notation of a color to numbers.
  const context = document.createElement("canvas").getContext("2d", {willReadFrequently: true});
  const numbers = (color) => {
    context.clearRect(0, 0, 1, 1);
    context.fillStyle = color;
    context.fillRect(0, 0, 1, 1);
    return [...context.getImageData(0, 0, 1, 1).data];
  };
  const luminance = (color) => numbers(color).slice(0, 3)
    .map((value) => value / 255)
    .map((value) => value <= 0.04045 ? value / 12.92 : ((value + 0.055) / 1.055) ** 2.4)
    .reduce((sum, value, index) => sum + value * [0.2126, 0.7152, 0.0722][index], 0);
  const ground = (element) => {
    for (let each = element; each; each = each.parentElement) {
      const color = getComputedStyle(each).backgroundColor;
      if (numbers(color)[3] === 255) return color;
    }
    return "white";
  };
  const own = (element) => [...element.childNodes]
    .some((node) => node.nodeType === 3 && node.textContent.trim());
  return [...document.querySelectorAll("body *:not(script)")].filter(own).map((element) => {
    const style = getComputedStyle(element);
    const color = element.closest("svg") ? style.fill : style.color;
    const [one, other] = [luminance(color), luminance(ground(element))];
    const contrast = (Math.max(one, other) + 0.05) / (Math.min(one, other) + 0.05);
    return [contrast, element.outerHTML.slice(0, 80)];
  });
}
"""


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_all_text_contrasts_with_its_background(opened, scheme):
    tab = opened(color_scheme=scheme)
    contrasts = tab.evaluate(CONTRASTS)
    assert len(contrasts) > 300
    assert [each for each in contrasts if each[0] < 4.5] == []


def colors(tab):
    return tab.evaluate(
        "() => ['color', 'backgroundColor'].map(it => getComputedStyle(document.body)[it])"
    )


def test_the_theme_follows_the_system_and_the_button(opened):
    tab = opened(color_scheme="dark")
    dark = colors(tab)
    tab.emulate_media(color_scheme="light")
    light = colors(tab)
    assert not set(light) & set(dark)
    tab.emulate_media(color_scheme="dark")
    button = tab.locator("#theme")
    themes = []
    for _ in range(3):
        button.click()
        themes.append((button.inner_text(), colors(tab)))
    assert themes == [("Theme: light", light), ("Theme: dark", dark), ("Theme: auto", dark)]


def test_text_in_curves_has_the_pages_color(opened):
    tab = opened(color_scheme="dark")
    ink = colors(tab)[0]
    fills = tab.locator(".drawing svg text").evaluate_all(
        "all => all.map(it => getComputedStyle(it).fill)"
    )
    assert fills
    assert set(fills) == {ink}


@pytest.mark.parametrize("script", [True, False])
def test_the_page_is_as_wide_as_a_phones_screen(opened, script):
    tab = opened(viewport={"width": 375, "height": 700}, java_script_enabled=script)
    if script:
        tab.locator("details.table summary").click()
    # A test can run scripts in a page that does not run its own.
    assert tab.evaluate("() => document.documentElement.scrollWidth") == 375


def test_without_scripts_enlarged_areas_show_and_sliders_do_not(opened):
    tab = opened(java_script_enabled=False)
    assert tab.locator(".crop img").first.is_visible()
    assert not tab.locator(".compare").first.is_visible()
    assert not tab.locator("#theme").is_visible()


def test_no_heading_skips_a_level(opened):
    levels = opened().evaluate(
        "() => [...document.querySelectorAll('h1, h2, h3, h4')].map(it => Number(it.tagName[1]))"
    )
    assert levels[0] == 1
    assert levels.count(1) == 1
    assert all(after - before <= 1 for before, after in itertools.pairwise(levels))
