"""Runs all cases of tests of which `make test` takes one or two: every machine's setup, and every view of the page.

make stress PROGRAM=every
"""

import os
import sys
from pathlib import Path

import pytest

TESTS = Path(__file__).parents[1]
ALL_CASES = ("runs/test_setup_rehearsal.py", "web/test_views.py")

if __name__ == "__main__":
    os.environ |= {"EVERY": "1", "EVERY_VIEW": "1"}
    sys.exit(pytest.main([*(str(TESTS / name) for name in ALL_CASES), *sys.argv[1:]]))
