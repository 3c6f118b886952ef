# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The page in a real browser without a window: it shows, and asks nobody for anything."""

import pytest

from rpms_ros.report.figures import FIGURES
from rpms_ros.report.page import SECTIONS

pytestmark = pytest.mark.long


@pytest.mark.parametrize('dark', [False, True])
def test_nobody_is_kept_from_reading_it(beside, tmp_path, page, dark):
    """Contrast, names, alternatives, headings, landmarks, tables, as axe-core finds them."""
    path = tmp_path / 'report.html'
    path.write_text(page, encoding='utf-8')
    with beside('devtools').Browser(tmp_path / 'profile') as shown:
        for width in (360, 1100):
            shown.screen(width, dark=dark)
            shown.open(path.as_uri())
            assert shown.accessibility_faults() == [], width
            assert shown.complaints() == []
            assert shown.evaluate('document.documentElement.scrollWidth <= innerWidth')
            widths = shown.evaluate(
                '[...document.querySelectorAll("figure img")].map((one) => one.naturalWidth)'
            )
            assert len(widths) == len(FIGURES)
            assert min(widths) > 300
        # every link can be reached and is seen where it is
        assert shown.beyond_the_keyboard() == []
        assert shown.evaluate('document.querySelectorAll("h2").length') == len(SECTIONS)
        asked = [one for one in shown.requested() if not one.startswith(('file:', 'data:'))]
        assert asked == []
