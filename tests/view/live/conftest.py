"""A fixture that closes live captures."""

import pytest

from jotlight.view.live.options import open_live


@pytest.fixture
def opened():
    captures = []

    def opened(*arguments, **options):
        captures.append(open_live(*arguments, {"frames": 1}, **options))
        return captures[-1]

    yield opened
    for capture in captures:
        capture.close()
