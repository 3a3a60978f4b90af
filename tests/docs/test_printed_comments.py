"""Comments that state what the code of a page prints."""

import pytest

from printed_comments import agrees, run_block, stated_prints


@pytest.mark.parametrize(
    ("stated", "printed", "expected"),
    [
        ("97%", "97% of the intervals", True),
        ("97%", "98% of the intervals", True),
        ("97%", "99% of the intervals", False),
        ("23.61 dB after 30 iterations", "23.67 dB after 32 iterations\n", False),
        ("26.28 dB", "26.3 dB", False),
        ("552", "16 of 552 pixels", True),
        ("frames 1: 7.9 dB ... frames 3: 9.0 dB", "frames 1: 7.9 dB\nframes 2: 8.2 dB\n", False),
        ("got uint8, ...", "expected floats, got uint8, whose scale", True),
        ("True", "False", False),
    ],
)
def test_comments_agree_with_what_is_printed(stated, printed, expected):
    assert agrees(stated, printed) == expected


def test_the_comment_of_a_print_is_beside_it_or_below():
    code = "x = 1  # no\nfor y in (x, 2):\n    print(\n        y\n    )  # 1 2\nprint(x)\n# 1\n"
    assert stated_prints(code) == {3: "1 2", 6: "1"}
    assert run_block(code, "page", {}) == {3: "1\n2\n", 6: "1\n"}
