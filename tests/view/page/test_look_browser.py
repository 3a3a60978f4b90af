"""The page in Chromium on phones, and in both themes."""

import pytest

pytestmark = pytest.mark.slow

PHONE = {"width": 390, "height": 844}


def test_all_buttons_fit_into_one_row_of_a_narrow_phone(opened):
    tab = opened("method=mle", viewport={"width": 360, "height": 740}, is_mobile=True)
    tops = tab.evaluate(
        "[...document.querySelectorAll('.actions button')]"
        ".map((e) => e.getBoundingClientRect().top)"
    )
    assert len(set(tops)) == 1


def test_phones_get_one_column_without_sideways_scrolling(opened):
    tab = opened("method=mle", viewport=PHONE, is_mobile=True, has_touch=True)
    assert tab.evaluate("document.documentElement.scrollWidth") == PHONE["width"]
    stage, panel = tab.locator("main").bounding_box(), tab.locator("aside").bounding_box()
    assert stage["y"] + stage["height"] <= panel["y"]
    assert stage["width"] == panel["width"] == PHONE["width"]


def test_the_length_of_the_window_ends_where_its_slider_ends(opened):
    tab = opened("method=mle", viewport=PHONE, is_mobile=True)
    right, end = (
        box["x"] + box["width"]
        for box in (
            tab.locator("#window-number").bounding_box(),
            tab.locator("#window").bounding_box(),
        )
    )
    assert right == pytest.approx(end, abs=1)


def test_the_controls_of_time_need_one_line_on_a_phone_that_lies(opened):
    tab = opened("method=mle", viewport={"width": 844, "height": 390}, is_mobile=True)
    play, *others = (
        tab.locator(each).bounding_box() for each in ("#play", "#window-number", "#window")
    )
    assert all(play["y"] <= box["y"] < play["y"] + play["height"] for box in others)


def test_the_list_of_keys_has_a_gap_above_its_button(opened):
    tab = opened("method=mle")
    tab.keyboard.press("?")
    above = tab.locator("#shortcuts .check").bounding_box()
    assert tab.locator("#close-shortcuts").bounding_box()["y"] >= above["y"] + above["height"] + 8


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_texts_have_enough_contrast(opened, scheme):
    tab = opened("method=mle", color_scheme=scheme)
    for name in ("--ink", "--quiet", "--mark"):
        for ground in ("--ground", "--raised"):
            ratio = tab.evaluate(
                """([name, ground]) => {
                  const read = (name) => {
                    const probe = document.createElement("span");
                    probe.style.color = `var(${name})`;
                    document.body.append(probe);
                    const color = getComputedStyle(probe).color.match(/[\\d.]+/g).map(Number);
                    probe.remove();
                    return color;
                  };
                  const light = (color) => {
                    const [r, g, b] = color.map((v) => v / 255)
                      .map((v) => (v <= 0.03928 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4));
                    return 0.2126 * r + 0.7152 * g + 0.0722 * b;
                  };
                  const [a, b] = [light(read(name)), light(read(ground))].sort((x, y) => y - x);
                  return (a + 0.05) / (b + 0.05);
                }""",
                [name, ground],
            )
            assert ratio >= 4.5, (scheme, name, ground, ratio)


def test_the_theme_can_be_chosen(opened):
    tab = opened("method=mle", color_scheme="light")
    ground = "getComputedStyle(document.body).backgroundColor"
    light = tab.evaluate(ground)
    tab.keyboard.press("v")
    assert tab.evaluate(ground) == light
    tab.keyboard.press("v")
    assert tab.evaluate(ground) != light


COVERED = """() => {
  const { activeElement: focused } = document;
  const box = focused.getBoundingClientRect();
  const top = document.elementFromPoint(box.x + box.width / 2, box.y + box.height / 2);
  const isOnTop = top !== null && (focused.contains(top) || top.contains(focused));
  return focused === document.body || isOnTop ? null : focused.outerHTML;
}"""


@pytest.mark.parametrize(("width", "height"), [(640, 400), (400, 800)])
def test_the_image_does_not_cover_what_has_the_focus(opened, width, height):
    tab = opened("method=mle", viewport={"width": width, "height": height})
    for key in ("Tab", "Shift+Tab"):
        for _ in range(31):
            tab.keyboard.press(key)
            assert tab.evaluate(COVERED) is None


def test_a_tablet_gets_targets_that_a_finger_hits(opened):
    tablet = {"width": 1180, "height": 820}
    tab = opened("method=mle", viewport=tablet, is_mobile=True, has_touch=True)
    targets = tab.locator("button:visible, select:visible, summary:visible, .check:visible")
    assert targets.count() > 20
    for index in range(targets.count()):
        assert targets.nth(index).bounding_box()["height"] >= 40
