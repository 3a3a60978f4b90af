"""`tools/viewer_figures.py` makes the screenshots that the guide shows."""

import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
GUIDE = ROOT / "docs/guide"


def figures(text):
    return set(re.findall(r"viewer-\w+\.jpg", text))


def test_the_guide_shows_all_figures_that_the_tool_makes():
    made = figures((ROOT / "tools/viewer_figures.py").read_text())
    assert made == figures((GUIDE / "viewing.md").read_text())
    assert made == {path.name for path in GUIDE.glob("viewer-*")}
